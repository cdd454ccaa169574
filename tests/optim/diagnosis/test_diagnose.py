"""Laws of a whole diagnosis, on recordings of a simulator that shares no code with the models."""

import json
import re
from dataclasses import FrozenInstanceError, dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.body_effects import LinkGeometry
from plumbline.experiments.reality.joint_effects import (
    GearRipple,
    JointCoupling,
    JointOffset,
    JointScale,
    TransmissionRipple,
)
from plumbline.kinematics.effects import EFFECTS, REGISTRY, Stage
from plumbline.kinematics.effects.backlash import Backlash
from plumbline.kinematics.effects.joint_coupling import JointCoupling as JointDrag
from plumbline.kinematics.effects.joint_offset import JointOffset as OwnOffset
from plumbline.kinematics.effects.link_thermal import LinkWarmUp
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.verdict.causes import _std_by_rows, always_words
from plumbline.optim.diagnosis.verdict.words import estimate_words, gap_words, shrink_words
from plumbline.optim.model import apply
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.loading import load_recording
from tests.benches import bench
from tests.few_effects import FEW_EFFECTS
from tests.made_up_diagnosis import BENCH
from tests.simulated_cases import causes, faultless, recorded, with_fault

ZERO_OR_WHEEL = DiagnosisOptions(library=(OwnOffset, REGISTRY["transmission_ripple"]))


def planted(folder, *faults, gap=4.0, **given):
    """A recording with faults in it."""
    return recorded(with_fault(faultless(**given), *faults, gap=gap), folder)[0]


@pytest.fixture(scope="module")
def ripple(tmp_path_factory):
    """A recording with a ripple of joint 3."""
    fault = TransmissionRipple(0.0, 3, once=(1.0, 0.5))
    return planted(tmp_path_factory.mktemp("ripple"), fault, rows=60, seed=5)


@pytest.fixture(scope="module")
def diagnosis(ripple):
    return diagnose(ripple, FEW_EFFECTS)


# What is said of a cause


def test_the_form_that_was_found_is_said(tmp_path):
    dragged = planted(tmp_path, JointCoupling(0.0, 3, source=2), gap=5.0, rows=60, seed=5)
    [cause] = diagnose(dragged, DiagnosisOptions(library=(JointDrag, OwnOffset))).verdict.causes
    assert cause.words == "joint 3 is dragged along by joint 2"
    twice = TransmissionRipple(0.0, 2, once=(0.0, 0.0), twice=(1.0, 0.4))
    other = planted(tmp_path / "twice", twice, gap=5.0, rows=60, seed=5)
    verdict = diagnose(other, ZERO_OR_WHEEL).verdict
    assert [cause.variant for cause in verdict.causes] == ["order 2"]
    assert verdict.to_dict()["causes"][0]["variant"] == "order 2"


def test_a_value_that_the_rows_do_not_tell_is_not_given_as_one(tmp_path):
    """The offset d along the first axis is the frame's height by another name."""
    bent = planted(tmp_path, LinkGeometry(0.0, 1, (0.0, 0.3, 1.0)), gap=6.0, rows=90, seed=5)
    found = diagnose(bent, FEW_EFFECTS)
    [cause] = found.causes
    told = {name: estimate.determined for name, estimate in cause.parameters.items()}
    assert (cause.effect, cause.element) == ("link_geometry", 1)
    assert told == {"d": False, "a": True, "alpha": True}
    assert estimate_words(cause.parameters["d"]).startswith("not determined")
    assert "not determined" not in estimate_words(cause.parameters["alpha"])
    by_rows = _std_by_rows(found.selected, bent.noise_std)[found.stated.terms[-1].columns]
    assert by_rows[0] > 1e3 * found.stated.problem.scale[-3]  # whatever is known beforehand


@dataclass(frozen=True)
class _LateZero(OwnOffset):
    """An effect of a user's own, which no list of the package holds."""

    name = "late_zero"


def test_an_effect_of_the_user_s_own_is_called_by_its_joint(tmp_path):
    off = planted(tmp_path, JointOffset(0.0, 3), gap=5.0, rows=60, seed=5)
    verdict = diagnose(off, DiagnosisOptions(library=(_LateZero,))).verdict
    assert verdict.causes[0].label == "late_zero of joint 3"
    assert verdict.staircase[-1].label == "late_zero of joint 3"


def test_where_no_noise_is_stated_no_floor_is_claimed(ripple):
    verdict = diagnose(replace(ripple, noise_std=None), ZERO_OR_WHEEL).verdict
    assert verdict.noise.source == "fit"
    assert np.isnan(verdict.gap.removable)
    said = " ".join((verdict.meaning, gap_words(verdict), shrink_words(verdict)))
    assert "no noise is stated" in said
    assert "floor" not in said
    assert "noise alone" not in said.lower()
    assert "leaves to remove" not in said


@pytest.mark.parametrize("kind", [Outcome.NO_GAP, Outcome.PARTLY])
def test_without_a_known_noise_what_is_left_is_told_by_how_it_looks(kind, diagnosis):
    verdict = replace(diagnosis.verdict, verdict=kind, outside_probability=0.9)
    unknown = replace(verdict, noise=replace(verdict.noise, source="fit"))
    assert "look like noise" in unknown.meaning
    assert "look like" not in verdict.meaning


def test_what_no_effect_shrinks_is_not_said_to_shrink_by_nothing(diagnosis):
    verdict = diagnosis.verdict
    still = replace(verdict, gap=replace(verdict.gap, after=verdict.gap.before, shrink=0.0))
    assert shrink_words(still).startswith("No effect of the library is in the model; every figure")


def test_a_verdict_whose_rows_left_out_are_missed_does_not_say_that_they_reach_the_floor(diagnosis):
    verdict = diagnosis.verdict
    assert verdict.meaning.endswith("held-out residual to the noise floor.")
    missed = replace(verdict.gap, after=3.0 * verdict.gap.noise_floor)
    far = replace(verdict, verdict=Outcome.PARTLY, gap=missed)
    assert far.meaning.endswith("they do not foretell.")
    few = replace(verdict, verdict=Outcome.NO_GAP, causes=(), gap=missed)
    assert "rows left out are missed by far" in few.meaning
    floor = replace(missed, after=missed.noise_floor)
    assert replace(few, gap=floor).meaning == "There is nothing beyond noise."


# What does not matter


def assert_same_verdict(other, diagnosis):
    assert other.verdict.verdict == diagnosis.verdict.verdict
    assert causes(other) == causes(diagnosis)
    assert other.verdict.gap.after == pytest.approx(diagnosis.verdict.gap.after, rel=0.05)


def test_the_same_recording_gives_the_same_verdict_whatever_its_name(ripple, diagnosis):
    assert causes(diagnosis) == [("transmission_ripple", 3)]
    renamed = diagnose(replace(ripple, name="joint_offset 1"), FEW_EFFECTS).verdict
    assert renamed.recording == "joint_offset 1"
    assert replace(renamed, recording=ripple.name).to_dict() == diagnosis.verdict.to_dict()


def bare(recording, rows=slice(None)):
    """Joint readings and tips alone, without time or any way to tell which row came first."""
    return build_recording(
        observation="tip_position", robot=recording.robot, q=recording.q[rows],
        measured=recording.measured[rows], tool_offset=recording.tool_offset,
        noise_std=recording.noise_std,
    )  # fmt: skip


def test_where_the_device_stands_changes_nothing(ripple):
    """But for effects of the device itself, which may differ along its axes."""
    library = (*ZERO_OR_WHEEL.library, REGISTRY["base_drift"], REGISTRY["link_geometry"])
    assert all(effect.stage != Stage.SENSOR for effect in library)
    R = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    moved = replace(ripple, measured=ripple.measured @ R.T + np.array([3.0, -2.0, 5.0]))
    one, two = (diagnose(r, DiagnosisOptions(library=library)).verdict for r in (ripple, moved))
    assert [c.label for c in one.causes] == [c.label for c in two.causes]
    assert two.gap.after == pytest.approx(one.gap.after, rel=1e-6)
    for here, there in zip(one.candidates, two.candidates, strict=True):
        assert there.probability == pytest.approx(here.probability, abs=1e-4)


def test_the_order_of_postures_does_not_matter(ripple):
    """Sorted by the joint that errs, what it does runs smoothly from row to row."""
    orders = slice(None), np.argsort(ripple.q[:, 2])
    straight, other = (diagnose(bare(ripple, rows), ZERO_OR_WHEEL) for rows in orders)
    assert causes(straight) == [("transmission_ripple", 3)]
    assert_same_verdict(other, straight)


def test_columns_that_mean_nothing_do_not_matter(ripple, diagnosis):
    rng = np.random.default_rng(2)
    more = replace(
        ripple, effort=rng.normal(0.0, 20.0, (60, 6)), velocity=rng.normal(0.0, 0.3, (60, 6))
    )
    reading = ("hysteresis", "friction", "latency", "transmission_ripple")
    readers = DiagnosisOptions(library=tuple(REGISTRY[name] for name in reading))
    assert causes(diagnose(more, readers)) == causes(diagnosis)


# What the verdict says


def keys(cls_or_dict):
    return set(cls_or_dict)


def test_the_verdict_is_strict_json_with_every_promised_key(diagnosis):
    text = json.dumps(diagnosis.verdict.to_dict(), allow_nan=False)

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    found = json.loads(text, parse_constant=refuse)
    assert found["verdict"] == "explained"
    promised = {"verdict", "gap", "where", "causes", "candidates", "outside_probability"}
    assert promised | {"unobservable", "next"} <= keys(found)
    gap = {"unit", "before", "after", "noise_floor", "shrink", "shrink_ci95", "held_out"}
    assert gap <= keys(found["gap"])
    assert keys(found["where"][0]) == {"stage", "element", "share"}
    cause = {"effect", "stage", "element", "probability", "parameters", "before", "after"}
    assert cause | {"confounded_with"} <= keys(found["causes"][0])
    for parameter in found["causes"][0]["parameters"].values():
        assert {"value", "std", "unit"} <= keys(parameter)
    assert found["gap"]["held_out"] is True
    assert found["gap"]["unit"] == "m"
    assert found["candidates"][0] == found["causes"][0]


def test_the_figures_agree_with_each_other(ripple, diagnosis):
    verdict, gap = diagnosis.verdict, diagnosis.verdict.gap
    norms = np.linalg.norm(diagnosis.residual_after[diagnosis.trusted], axis=1)
    assert gap.after == pytest.approx(np.sqrt(np.mean(norms**2)))
    assert gap.shrink == pytest.approx(1 - gap.after / gap.before)
    assert gap.shrink_ci95[0] < gap.shrink < gap.shrink_ci95[1]
    assert gap.noise_floor == pytest.approx(np.sqrt(3.0) * ripple.noise_std)
    assert gap.after < 1.2 * gap.noise_floor < 0.5 * gap.before
    assert verdict.rows == len(ripple)
    assert verdict.sha256 == ripple.sha256
    steps = [step.gap for step in verdict.staircase]
    assert steps[0] == pytest.approx(gap.before, rel=0.02)
    assert steps[-1] == pytest.approx(verdict.causes[0].after)
    assert verdict.causes[0].probability > 0.95


@pytest.mark.parametrize(
    ("observation", "always", "words"),
    [
        ("tip_position", ("frame", "tool"), "frame and tool alone"),
        ("pose", ("frame", "tool"), "frame and tool alone"),
        ("fixed_point", ("frame", "tool"), "sockets and tool alone"),
        ("fixed_point", ("tool",), "sockets and tool alone"),
        ("tip_position", ("frame", "tool", "joint_offset"), "before"),
        ("tip_position", ("frame",), "before"),
        ("joint_position", ("joint_offset",), "zeros of the encoders alone"),
        ("joint_position", ("frame", "tool"), "before"),
        ("joint_position", ("joint_offset", "latency"), "before"),
    ],
)
def test_the_staircase_starts_at_what_is_always_fitted(observation, always, words):
    recording = replace(bench("ur5", observation), always=always)
    assert always_words(recording) == words


def test_a_planted_offset_has_its_value_within_its_error(tmp_path):
    case = with_fault(faultless(rows=60, seed=5), JointOffset(0.0, 3))
    [cause] = diagnose(recorded(case, tmp_path)[0], ZERO_OR_WHEEL).verdict.causes
    estimate = cause.parameters["offset"]
    assert abs(estimate.value - case.effects[0].size) < 4 * estimate.std
    assert estimate.std < 0.05 * abs(estimate.value)


def test_without_a_gap_nothing_is_blamed(tmp_path):
    verdict = diagnose(recorded(faultless(rows=50, seed=21), tmp_path)[0], FEW_EFFECTS).verdict
    assert verdict.verdict == Outcome.NO_GAP
    assert verdict.causes == ()
    assert verdict.where == ()
    assert verdict.gap.before == verdict.gap.after
    assert verdict.gap.shrink == 0.0


@pytest.mark.parametrize(("observation", "noise_std"), [("pose", 1e-4), ("joint_position", None)])
def test_readings_without_any_noise_are_no_gap(observation, noise_std):
    verdict = diagnose(bench("ur5", observation, noise_std=noise_std), ZERO_OR_WHEEL).verdict
    assert verdict.verdict == Outcome.NO_GAP
    assert verdict.gap.before < 1e-9


def test_a_verdict_cannot_be_changed(diagnosis):
    with pytest.raises(FrozenInstanceError):
        diagnosis.verdict.verdict = Outcome.NO_GAP
    with pytest.raises(FrozenInstanceError):
        diagnosis.verdict.gap.after = 0.0
    with pytest.raises(FrozenInstanceError):
        diagnosis.verdict = None


def test_progress_is_told_from_nought_to_one(tmp_path):
    told = []
    recording = recorded(faultless(rows=40, seed=21), tmp_path)[0]
    diagnose(recording, ZERO_OR_WHEEL, progress=lambda words, share: told.append((words, share)))
    shares = [share for _, share in told]
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert told[-1] == ("done", 1.0)


# Which effects compete


def test_what_is_always_fitted_is_no_candidate(tmp_path):
    fault = JointScale(0.0, 3)
    recording = planted(tmp_path, fault, rows=60, seed=5)
    held = replace(recording, always=("frame", "tool", "joint_scale"))
    options = DiagnosisOptions(library=(REGISTRY["joint_scale"], *ZERO_OR_WHEEL.library))
    verdict = diagnose(held, options).verdict
    assert causes(diagnose(recording, options)) == [("joint_scale", 3)]
    assert "joint_scale" not in {c.effect for c in verdict.candidates}
    assert verdict.verdict == Outcome.NO_GAP


# Other recordings of the same arm, other observations


def test_what_was_fitted_helps_on_another_recording_of_the_arm(tmp_path):
    """The effects' values are kept; two orders of one ripple are not mistaken for each other."""
    orders = (GearRipple(0.0, 2, 12.0, 0.3), GearRipple(0.0, 2, 31.0, 1.0))
    first = with_fault(faultless(rows=90, seed=34), *orders)
    second = replace(faultless(rows=30, seed=31), effects=first.effects, gap_to_noise=(4.0, 4.0))
    gears = DiagnosisOptions(library=(REGISTRY["gear_ripple"], OwnOffset))
    found = diagnose(recorded(first, tmp_path)[0], gears)
    other = recorded(second, tmp_path)[0]
    transfer = found.transfer(other)
    assert causes(found) == [("gear_ripple", 2)]
    assert len(found.effects) == 2
    assert transfer.unit == "m"
    assert transfer.after < 0.5 * transfer.before
    assert transfer.after < 1.3 * np.sqrt(3.0) * other.noise_std


@pytest.mark.parametrize("observation", ["fixed_point", "pose", "joint_position"])
def test_a_planted_fault_is_found_whatever_was_observed(observation, tmp_path):
    fault = TransmissionRipple(0.0, 3, once=(1.0, 0.5))
    recording = planted(tmp_path, fault, rows=60, seed=6, observation=observation)
    diagnosis = diagnose(recording, ZERO_OR_WHEEL)
    assert causes(diagnosis) == [("transmission_ripple", 3)]
    assert diagnosis.verdict.gap.unit == ("rad" if observation == "joint_position" else "m")
    assert diagnosis.residual_after.shape[0] == 60


def test_of_poses_the_gap_says_how_far_the_tool_is_turned():
    """About its own shaft, which no place of its tip shows."""
    robot, rng = Robot.bundled("ur5"), np.random.default_rng(3)
    q, tool = rng.uniform(-1.5, 1.5, (60, 6)), np.array([0.0, 0.0, 0.1])
    T = robot.chain().placement(q)
    places = T[:, :3, 3] + T[:, :3, :3] @ tool + rng.normal(0.0, 1e-4, (60, 3))
    turns = Rotation.from_matrix(T[:, :3, :3])
    turns = turns * Rotation.from_rotvec([[0.0, 0.0, 2e-3 * np.sin(a)] for a in q[:, 5]])
    turns = turns * Rotation.from_rotvec(rng.normal(0.0, 2e-4, (60, 3)))
    read = np.hstack([places, turns.as_quat(scalar_first=True)])
    noise = {"noise_std": 1e-4, "noise_std_rotation": 2e-4}
    given = {"observation": "pose", "robot": robot, "q": q, "measured": read, "tool_offset": tool}
    verdict = diagnose(build_recording(**given, **noise), FEW_EFFECTS).verdict
    assert verdict.causes[0].element == 6
    assert abs(verdict.gap.shrink) < 0.05
    rotation = verdict.gap.rotation
    assert rotation.before > 3.0 * rotation.after
    assert 0.8 < rotation.after / rotation.noise_floor < 1.2
    assert rotation.noise_floor == pytest.approx(2e-4 * np.sqrt(3.0))
    assert "the tool is turned by" in shrink_words(verdict)


def test_a_robot_without_masses_is_said_to_have_none(diagnosis):
    rows = [{"d": 0.1, "a": 0.4, "alpha": a, "theta": 0.0} for a in (np.pi / 2, 0.0, np.pi / 2)]
    massless = bench(Robot.from_dh(rows), "tip_position", noise_std=1e-4)
    notes = " ".join(diagnose(massless, ZERO_OR_WHEEL).verdict.notes)
    assert "masses are not given" in notes
    assert "masses are not given" not in " ".join(diagnosis.verdict.notes)


@pytest.fixture(scope="module")
def carried():
    """The model that the bundled recording has, and the recording without its columns."""
    recording = load_recording(BENCH)
    bare = replace(recording, time=None, temperature=None, direction=None, group=None)
    return diagnose(recording, ZERO_OR_WHEEL).model(), bare


def test_a_model_carries_over_to_a_recording_that_lacks_its_columns(carried):
    found, bare = carried
    more = _with(found, REGISTRY["backlash"](joint=2))
    assert apply(more, bare).after == pytest.approx(apply(found, bare).after)


@pytest.mark.parametrize(
    ("effect", "kept"),
    [(LinkWarmUp(time_constant=500.0), ("temperature",)), (Backlash(2), ("velocity",))],
)
def test_a_variant_that_another_recording_cannot_read_is_not_carried_over(effect, kept, carried):
    """The recording has another column, with which another variant would make do."""
    found, bare = carried
    columns = {"temperature": np.linspace(20.0, 25.0, len(bare)), "velocity": np.ones(bare.q.shape)}
    bare = replace(bare, **{name: columns[name] for name in kept})
    more = _with(found, effect)
    assert apply(more, bare).after == pytest.approx(apply(found, bare).after)
    [left_out] = set(apply(more, bare).left_out) - set(apply(found, bare).left_out)
    assert effect.name in left_out


def _with(model, effect):
    """A model with one effect of one parameter more."""
    covariance = np.pad(model.covariance, ((0, 1), (0, 1)))
    values = np.append(model.values, 1e-2)
    return replace(model, effects=(*model.effects, effect), values=values, covariance=covariance)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"held_out": "moon"}, "held_out: found 'moon', expected one of auto, groups"),
        ({"seed": -1}, "seed: found -1, expected 0 to 4294967295"),
        ({"without": ["backlsh"]}, "without 'backlsh' not recognised. Best matches are backlash"),
        ({"without": "backlash"}, "without: found 'backlash', expected a list"),
        ({"without": ["latency"], "library": (REGISTRY["joint_scale"],)}, "Best matches are"),
    ],
)
def test_options_that_there_are_not_are_refused_in_one_line(options, words):
    with pytest.raises(PlumblineError, match=re.escape(words)) as caught:
        DiagnosisOptions(**options)
    assert "\n" not in str(caught.value)


def test_an_effect_that_is_left_out_is_not_considered():
    kept = DiagnosisOptions(without=["backlash", "latency"]).effects
    assert set(EFFECTS) - set(kept) == {REGISTRY["backlash"], REGISTRY["latency"]}

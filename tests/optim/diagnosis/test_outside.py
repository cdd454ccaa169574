"""Laws of what the library lacks: it is flagged, with what it depends on; what it has is not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.experiments.reality.body_effects import (
    BaseCompliance,
    JointTilt,
    LinkFlex,
    LinkThermal,
)
from plumbline.experiments.reality.end_effects import SensorScale
from plumbline.experiments.reality.joint_effects import (
    CoupledPlay,
    JointCompliance,
    JointMechanism,
    JointScale,
    LoadedPlay,
    Payload,
    TransmissionRipple,
)
from plumbline.experiments.reality.outside_effects import CrossRipple, MagneticSpot, StickSlip
from plumbline.experiments.reality.scene import Mechanism
from plumbline.experiments.reality.unseen.bodies import BearingRunout, ToolRocking
from plumbline.experiments.reality.unseen.joints import HubSlip
from plumbline.kinematics.effects.joint_coupling import JointCoupling
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple as ModelledRipple
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.body_dependences import _of_links
from plumbline.optim.diagnosis.discrepancy.dependences import dependences
from plumbline.optim.diagnosis.discrepancy.functions import normal
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.meaning import NOISIER
from plumbline.optim.diagnosis.posterior.search import SOLVER, fit
from plumbline.optim.diagnosis.verdict.explanation import explain
from plumbline.optim.diagnosis.verdict.lack_of_fit import noisiest_joint
from plumbline.optim.diagnosis.verdict.words import left_over, what_to_vary
from plumbline.optim.measurement.nuisance import nuisances_of
from tests.benches import bench
from tests.explained import library_without, searched, told
from tests.few_effects import FEW_EFFECTS, few_and, only
from tests.simulated_cases import faultless, recorded, with_fault

# Beside the few, what could be taken for what is wrong here.
OF_LOADS = ("joint_tilt", "link_flex", "base_compliance", "payload")
COUPLED = only("joint_offset", "joint_scale", "backlash", "joint_coupling", "coupled_play")
SEEN = only("joint_offset", "joint_scale", "base_bump", "sensor_scale", "sensor_distortion")
ZEROS = ("joint_offset", "joint_scale", "transmission_ripple")
OF_JOINTS = only(*ZEROS, "backlash", "hysteresis", "joint_coupling", "coupled_play")
OF_PLAY = only(*ZEROS, "backlash", "hysteresis", "coupled_play").library
OF_BODIES = only(*ZEROS, "link_geometry", "joint_tilt", "link_flex", "link_thermal").library
OF_DRIVES = only(*ZEROS, "joint_compliance", "base_bump", *OF_LOADS)


def spot(case, reach=0.5):
    """A field around the middle of the readings, half as wide as they are."""
    points, _ = case.scene.pose_in_device()
    size = np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1)))
    centre = tuple(float(v) for v in points[7])
    return MagneticSpot(0.0, centre, reach * float(size), (0.6, 0.0, 0.8))


def crossed(joint, other, folder):
    """A recording of a joint whose error depends on another one's angle."""
    fault = CrossRipple(0.0, joint, other, order=0.0, mesh=2.0, phase=0.4)
    return recorded(with_fault(faultless(rows=60, seed=joint), fault), folder)[0]


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """The verdict on readings with a field around a place."""
    case = faultless(rows=50, seed=9)
    folder = tmp_path_factory.mktemp("field")
    return diagnose(recorded(with_fault(case, spot(case)), folder)[0], SEEN).verdict


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """A recording in which joint 2's error depends on joint 3's angle."""
    return crossed(2, 3, tmp_path_factory.mktemp("bent"))


def test_a_joint_that_sticks_and_slips_is_no_cause_of_the_library(tmp_path):
    case = with_fault(faultless(rows=60, seed=21), StickSlip(0.0, 4, 21), gap=2.5)
    found = told(recorded(case, tmp_path)[0], OF_JOINTS.library)
    assert found.named == frozenset()
    assert found.lacked_at["joint", 4] > 0.95
    assert found.words == "joint 4's error depends on what went before"


def test_one_joint_s_error_that_depends_on_another_is_named(bent):
    verdict = diagnose(bent, COUPLED).verdict
    assert verdict.verdict == Outcome.OUTSIDE
    assert verdict.outside_depends_on == "joint 2's error depends on joint 3's angle"
    assert verdict.outside_probability > 0.99
    assert [(p.stage, p.element, p.share) for p in verdict.where] == [("joint", 2, 1.0)]


def test_what_follows_a_posture_is_told_whatever_the_chains_draw(tmp_path):
    """Of a draw of functions one had told the load on the base, the next an eccentric wheel."""
    recording, _ = recorded(faultless(rows=40, seed=9), tmp_path)
    smooth = np.sin(normal(recording.q) @ [0.5, -0.5, 0.5, 0.0, -0.5, 0.5])[:, None]
    off = 3.0 * recording.noise_std * smooth * [0.6, 0.0, 0.8]
    found, _ = searched(replace(recording, measured=recording.measured + off), FEW_EFFECTS.library)
    first, other = (explain(found, seed) for seed in (0, 1))
    assert first.words == "the posture"
    assert other.words == first.words
    assert other.unlisted == pytest.approx(first.unlisted, abs=0.02)


def test_a_field_around_a_place_is_flagged_as_depending_on_the_place(field):
    assert field.verdict == Outcome.OUTSIDE
    assert field.outside_depends_on.startswith("the place of the tip")
    assert field.where[0].stage == "sensor"
    assert field.where[0].share > 0.8


def test_a_narrow_field_is_flagged_as_local(tmp_path):
    case = faultless(rows=54, seed=8)
    recording, _ = recorded(with_fault(case, spot(case, reach=0.3), gap=1.5), tmp_path)
    assert told(recording, SEEN.library).words == "the place of the tip, locally"


def test_a_ripple_whose_phase_another_joint_sets_is_named(tmp_path):
    joint, other = 4, 1
    fault = CrossRipple(0.0, joint, other, order=3.0, mesh=1.0, phase=1.0)
    case = with_fault(faultless(rows=70, seed=joint), fault, gap=1.2)
    found = told(recorded(case, tmp_path)[0], OF_JOINTS.library)
    assert found.unlisted > 0.95
    assert found.words == f"joint {joint}'s error depends on its own and joint {other}'s angle"


def test_what_nobody_lists_of_a_link_holds_no_place_of_its_own(tmp_path):
    """Else one term would stand for the geometry of several links and cost one cause."""
    recording, _ = recorded(faultless(rows=40, seed=2), tmp_path)
    N, n = recording.q.shape
    ports = SimpleNamespace(link=np.ones((n, 6, N, 3)), joint=np.zeros((n, N, 3)))
    found = list(_of_links(recording, ports))
    assert {f.on for f in found} == {"load"}
    for family in found:
        np.testing.assert_allclose(family.columns.mean(axis=1), 0.0, atol=1e-12)


def test_an_axis_that_runs_out_as_it_turns_is_its_joint_s(tmp_path):
    """A link that is rigid moves in its joint as the axis does, and its mean is no cause beside."""
    joint = 5
    fault = BearingRunout(0.0, joint, order=1.6, phase=0.7)
    recording, _ = recorded(with_fault(faultless(rows=70, seed=4), fault, gap=2.5), tmp_path)
    found = told(recording, OF_BODIES)
    assert found.lacked_at["joint", joint] > 0.95
    assert found.words == f"joint {joint}'s axis runs out as it turns"
    assert found.named == frozenset()


class AxisFloat(Mechanism):
    """A link moves along its joint's axis as that turns, or across it: a bearing without a stop."""

    joint: int = 2
    way: int = 2  # of the joint's frame, from 0
    effect = "axis_float"

    def body(self, scene):
        along = np.zeros((scene.session.rows, 6))
        along[:, self.way] = self.size * np.sin(scene.session.q[:, self.joint - 1] + 1.0)
        return scene.flexed(self.joint - 2, along)


class WarmZero(JointMechanism):
    """A zero that settles within a fifth of the session."""

    effect = "warm_zero"

    def _error(self, scene):
        return -self.size * np.expm1(-5.0 * scene.session.progress)


@pytest.mark.parametrize(("joint", "way"), [(2, 2), (4, 0)])
def test_an_axis_that_floats_as_it_turns_is_its_joint_s(joint, way, tmp_path):
    recording, _ = recorded(
        with_fault(faultless(rows=42, seed=4), AxisFloat(0.0, joint, way), gap=2.0), tmp_path
    )
    assert told(recording, OF_BODIES).lacked_at["joint", joint] > 0.95


class Overshoot(JointMechanism):
    """A joint that goes on over where it stops: play of the other sign, which no play has."""

    effect = "overshoot"

    def _error(self, scene):
        return 0.5 * self.size * scene.session.direction[:, self.joint - 1]


def test_play_of_the_other_sign_is_its_joint_s_and_no_other_s(tmp_path):
    """It had been one of all joints, or one that hangs on the angle too."""
    joint = 6
    case = with_fault(faultless(rows=70, seed=4), Overshoot(0.0, joint), gap=2.0)
    found = told(recorded(case, tmp_path)[0], OF_PLAY)
    assert found.lacked_at["joint", joint] > 0.9
    assert found.words == f"joint {joint}'s error depends on the way it came"
    assert not found.named


def test_a_zero_that_settles_is_its_joint_s_though_the_base_could_turn_so(tmp_path):
    """One number does what six do, and is no further form of anything listed."""
    case = with_fault(faultless(rows=70, seed=4), WarmZero(0.0, 1), gap=2.0)
    found = told(recorded(case, tmp_path)[0], only(*ZEROS, "base_drift", "base_bump").library)
    assert found.lacked_at["joint", 1] > 0.95
    assert not found.named


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (JointTilt(0.0, 4, 0.1), "joint 4's axis gives way to its load"),
        (CoupledPlay(0.0, 5, 3), "joint 5's error depends on the way it came"),
    ],
)
def test_what_moves_a_joint_s_axis_or_comes_by_another_s_side_is_its_own(fault, words, tmp_path):
    """Where no listed effect does it."""
    recording, _ = recorded(with_fault(faultless(rows=90, seed=4), fault, gap=2.0), tmp_path)
    beside = ("backlash", "joint_tilt", "coupled_play", "hysteresis", "link_flex")
    found = told(recording, only(*ZEROS, *(e for e in beside if e != fault.effect)).library)
    assert found.words == words
    assert found.lacked_at["joint", fault.joint] > 0.95


@pytest.mark.parametrize(
    ("fault", "place", "least"),
    [
        (SensorScale(0.0), ("sensor", None), 0.95),
        (LinkThermal(0.0, 20.0), ("link", None), 0.95),
        (Payload(0.0, (2e4,) * 6), ("tool", None), 0.95),
        (BaseCompliance(0.0, 1.0), ("base", None), 0.6),
    ],
)
def test_what_is_as_simple_as_what_the_library_lacks_is_not_taken_for_another_effect(
    fault, place, least, tmp_path
):
    """All lengths grow alike. A weight at the tip twists all drives in one measure.

    Two compliances had stood for it, and for a base that tilts a first link that bends.
    """
    recording, _ = recorded(with_fault(faultless(rows=90, seed=8), fault, gap=2.5), tmp_path)
    beside = (*OF_LOADS, "link_thermal", "coupled_play", "tool_offset", "sensor_distortion")
    found = told(recording, few_and(*beside, without=fault.effect).library)
    assert found.lacked_at[place] > 0.95
    assert found.unlisted > least
    assert all(p <= 1.0 - least for p in found.probabilities.values())


def test_play_that_changes_sides_with_the_load_may_be_a_drive_that_is_soft_near_none(tmp_path):
    """Neither does better: each has what it had before the data, of the whole library."""
    fault = LoadedPlay(0.0, 4, 0.02)
    recording, _ = recorded(with_fault(faultless(rows=90, seed=8), fault, gap=2.5), tmp_path)
    found = told(recording, library_without(fault.effect))
    assert found.lacked_at["joint", 4] > 0.95
    assert found.unlisted > 0.1
    assert all(p <= 0.9 for p in found.probabilities.values())


def test_a_link_that_bends_is_told_as_the_link_not_as_the_joint_before_it(tmp_path):
    """It bends about its middle under the weights beyond it, in one measure."""
    recording, _ = recorded(
        with_fault(faultless(rows=60, seed=8), LinkFlex(0.0, 3), gap=1.0), tmp_path
    )
    library = few_and(*OF_LOADS, "link_thermal", without="link_flex").library
    assert told(recording, library).lacked_at == {("link", 3): 1.0}


@pytest.mark.parametrize("clock", [True, False])
def test_without_a_clock_nobody_says_that_rows_stand_in_the_order_of_time(clock, tmp_path):
    """Steps from row to row had passed, in one order of nine, for how a cause deviates."""
    recording, _ = recorded(faultless(rows=40, seed=2), tmp_path)
    recording = recording if clock else replace(recording, time=None)
    nuisance = nuisances_of(recording)
    model, fitted = fit(recording, [], nuisance, np.ones(40), SOLVER)
    ports = Ports.about(model, fitted.x, np.arange(40))
    found = {family.on for family in dependences(recording, ports)}
    assert ({"history", "moment"} <= found) == clock
    assert clock or found.isdisjoint({"history", "moment"})


def test_a_joint_that_slips_once_is_no_bump_of_the_base(tmp_path):
    """Though the base, were it to move by where the arm leans, could do the same."""
    case = faultless(rows=90, seed=6)
    time = case.scene.session.time
    moment = float(np.interp(150.0, [0.0, 450.0], [time[0], time[-1]]))
    recording, _ = recorded(with_fault(case, HubSlip(0.0, 2, moment), gap=2.5), tmp_path)
    found = told(recording, FEW_EFFECTS.library)
    assert found.lacked_at["joint", 2] > 0.95
    assert found.words == "joint 2's zero jumped once"


@pytest.mark.parametrize("stated", [True, False])
def test_an_arm_on_a_wall_that_nobody_speaks_of_is_told_by_its_loads(stated, tmp_path):
    def on_a_wall(arm):
        return replace(arm, gravity=np.array([0.0, 9.81, 0.0]))

    case = faultless(rows=60, seed=7)
    case = replace(case, scene=replace(case.scene, arm=on_a_wall(case.scene.arm)))
    case = with_fault(case, JointCompliance(0.0, 2), gap=3.0)
    case = replace(case, arm=on_a_wall(case.arm)) if stated else case
    found = told(recorded(case, tmp_path)[0], OF_DRIVES.library)
    if stated:
        assert found.named == {("joint_compliance", 2)}
        return
    other = "in another mounting than [robot] gravity states"
    assert found.words == f"joint 2's error depends on its load {other}"
    assert not found.named


def test_a_tool_that_rocks_in_its_seat_is_told_as_the_tool_not_as_the_last_link_alone(tmp_path):
    fault = ToolRocking(0.0, (0.6, 0.8, 0.0), (0.0, 0.6, 0.8), bias=0.1)
    recording, _ = recorded(with_fault(faultless(rows=90, seed=5), fault, gap=2.5), tmp_path)
    found = told(recording, few_and(*OF_LOADS, "needle_sag", "tool_offset").library)
    assert found.lacked_at == {("tool", None): 1.0}
    assert found.words == "how the tool sits, or the shape of link 6, or its weight"


def test_a_tip_at_rest_in_sockets_has_no_place_of_its_own(tmp_path):
    """There the place of the nominal tip holds the very error that it would explain."""
    recording, _ = recorded(faultless(rows=40, seed=3, observation="fixed_point"), tmp_path)
    nuisance, weights = nuisances_of(recording), np.ones(len(recording))
    model, best = fit(recording, (), nuisance, weights, SOLVER)
    ports = Ports.about(model, best.x, np.arange(len(recording)))
    words = {d.words for d in dependences(recording, ports)}
    assert "the posture" in words
    assert not [w for w in words if w.startswith("the place of the tip")]


def test_an_effect_of_the_library_is_not_flagged_once_it_is_in_the_model(tmp_path):
    case = with_fault(faultless(rows=60, seed=5), TransmissionRipple(0.0, 3, once=(1.0, 0.5)))
    recording, _ = recorded(case, tmp_path)
    found = told(recording, [ModelledRipple])
    assert found.named == {("transmission_ripple", 3)}
    assert found.unlisted < 0.2
    assert found.words == ""
    # Without its effect in the library it is seen, as an unknown of the same joint.
    bare = told(recording, ())
    assert bare.unlisted > 0.99
    assert bare.lacked_at == {("joint", 3): 1.0}


def test_noise_alone_is_nothing_unknown(tmp_path):
    for seed in range(2):
        recording, _ = recorded(faultless(rows=50, seed=20 + seed), tmp_path)
        found = told(recording, ())
        assert found.unlisted < 0.2
        assert found.words == ""


def test_without_the_true_effect_in_the_library_it_is_never_named(tmp_path):
    case = with_fault(faultless(rows=60, seed=8), TransmissionRipple(0.0, 3, once=(1.0, 0.5)))
    recording, _ = recorded(case, tmp_path)
    found = told(recording, few_and(without="transmission_ripple").library)
    assert found.unlisted > 0.5
    known = {effect for effect, _ in found.probabilities}
    assert "transmission_ripple" not in known
    assert "joint_offset" in known


@pytest.mark.parametrize(("stiffening", "gap"), [(0.0, 2.0), (0.7, 1.7)])
def test_an_effect_left_out_is_told_by_its_joint_as_simply_as_if_it_was_listed(
    stiffening, gap, tmp_path
):
    """No freedom that it does not use hides it: else all joints' loads together stand for it.

    Nor does that it stiffens with its load: else play and another joint's tilt do.
    """
    case = with_fault(faultless(rows=40, seed=8), JointCompliance(0.0, 3, stiffening), gap=gap)
    library = few_and(*OF_LOADS, without="joint_compliance").library
    found = told(recorded(case, tmp_path)[0], library)
    assert found.unlisted > 0.95
    assert found.lacked_at == {("joint", 3): 1.0}


def test_drives_that_are_equally_soft_are_soft_drives(tmp_path):
    """It had been one unlisted function of all loads, which pays for one number, at 0.98."""
    alike = tuple(JointCompliance(2e-5, joint, stiffening=0.0) for joint in range(1, 7))
    case = replace(faultless(rows=60, seed=8), effects=alike, gap_to_noise=(1.0,) * 6)
    found = told(recorded(case, tmp_path)[0], OF_DRIVES.library)
    assert found.unlisted < 0.5
    assert {effect for effect, _ in found.named} == {"joint_compliance"}
    assert all(found.probabilities["joint_compliance", joint] > 0.95 for joint in (2, 3))


def test_a_cause_beside_an_unknown_is_named_and_explains_a_part(tmp_path):
    case = faultless(rows=36, seed=5)
    recording, _ = recorded(with_fault(case, JointScale(0.0, 3), spot(case)), tmp_path)
    partly = diagnose(recording, SEEN).verdict
    assert partly.verdict == Outcome.PARTLY
    assert partly.outside_probability > 0.95
    assert partly.outside_depends_on.startswith("the place of the tip")
    assert ("joint_scale", 3) in {(c.effect, c.element) for c in partly.causes}


def test_a_coupling_that_is_bent_is_a_coupling_or_nearly_one(tmp_path):
    """Which of the two its bend decides; where it sits and on what it depends is sure."""
    joint, other = 4, 3
    bent = CrossRipple(0.0, joint, other, order=0.0, mesh=0.4, phase=0.3)
    recording, _ = recorded(with_fault(faultless(rows=30, seed=joint), bent, gap=3.0), tmp_path)
    verdict = diagnose(recording, COUPLED).verdict
    place = verdict.tree[0]
    assert (place["stage"], place["element"]) == ("joint", joint)
    assert place["probability"] > 0.95
    assert place["dependences"][0]["on"] == "another joint's angle"
    assert {m["effect"] for m in place["dependences"][0]["mechanisms"]} <= {"joint_coupling", None}
    if not verdict.causes:
        assert verdict.outside_depends_on.startswith("nearly as joint_coupling has it")
    bare = told(recording, only(*ZEROS, "backlash", "coupled_play").library)
    assert bare.unlisted > 0.99
    assert bare.words == f"joint {joint}'s error depends on joint {other}'s angle"


@pytest.mark.parametrize(
    ("said", "sentence", "thing"),
    [
        ("temperature", "what is left depends on temperature", "temperature"),
        (
            "joint 2's error depends on its speed",
            "what is left: joint 2's error depends on its speed",
            "its speed",
        ),
        (
            "nearly as base_bump has it, the base's error depends on time",
            "what is left: the base's error depends on time, nearly as base_bump has it",
            "time",
        ),
        (
            "rows 3, 9: one shift of the tool explains them",
            "what is left: rows 3, 9: one shift of the tool explains them",
            "",
        ),
    ],
)
def test_an_unknown_is_told_in_a_sentence_and_its_thing_can_be_varied(said, sentence, thing):
    assert left_over(said) == sentence
    assert what_to_vary(said) == thing


def test_what_is_not_named_is_no_surer_than_that_nothing_unknown_is_there(field):
    assert field.outside_probability > 0.99
    assert all(c.probability < 0.05 for c in field.candidates if c not in field.causes)


@pytest.mark.parametrize("joints", [(0, 1, 2, 3, 4, 5), (2, 4, 5)])
def test_a_second_encoder_that_scatters_is_named_by_its_joint(joints):
    """Noise of one joint alone depends on nothing; words are of that very joint."""
    quiet = bench("ur5", "joint_position")
    rng = np.random.default_rng(8)
    sigma = np.full(6, 1e-4)
    sigma[joints[1]] = 3e-4
    readings = quiet.measured + rng.normal(0.0, sigma, quiet.measured.shape)
    usual = float(np.sqrt(np.mean(sigma[list(joints)] ** 2)))
    noisy = replace(quiet, measured=readings, measured_joints=joints, noise_std=usual)
    found, _ = searched(noisy, [JointCoupling])
    assert explain(found, 0).unlisted < 0.05
    words = f"joint {joints[1] + 1}'s error changes from reading to reading"
    assert noisiest_joint(noisy, found) == words


def test_more_noise_than_stated_depends_on_nothing(tmp_path):
    recording, _ = recorded(faultless(rows=60, seed=2), tmp_path)
    understated = replace(recording, noise_std=recording.noise_std / 1.6)
    verdict = diagnose(understated, FEW_EFFECTS).verdict
    assert verdict.verdict in (Outcome.NO_GAP, Outcome.PARTLY)
    assert verdict.is_noisier
    assert verdict.meaning == NOISIER
    assert all(c.probability < 0.7 for c in verdict.candidates)
    assert verdict.outside_depends_on == ""
    assert verdict.causes or verdict.where == ()


@pytest.mark.parametrize("size", [0.05, 1.0])
def test_a_gross_row_is_left_out_however_gross_it_is(size, tmp_path):
    case = with_fault(faultless(rows=24, seed=3), TransmissionRipple(1e-4, 2), gap=5.0)
    recording, _ = recorded(case, tmp_path)
    spoilt = recording.measured.copy()
    spoilt[5, 1] += size
    selected, bad = searched(replace(recording, measured=spoilt), FEW_EFFECTS.library)
    found = explain(selected, 0)
    assert found.named == {("transmission_ripple", 2)}
    assert found.unlisted < 0.5
    np.testing.assert_array_equal(np.flatnonzero(bad), [5])


def test_a_joint_that_errs_with_the_payload_is_named_with_it():
    clean = bench("ur5", "tip_position", columns=())
    rng = np.random.default_rng(3)
    payload = rng.choice([0.0, 0.5, 1.0], len(clean))
    true = clean.q.copy()
    true[:, 1] += 1e-3 * payload
    tips = bench("ur5", "tip_position", columns=(), q=true).measured
    tips = tips + rng.normal(0.0, 1e-4, tips.shape)
    noisy = replace(clean, payload=payload, measured=tips, noise_std=1e-4)
    found = told(noisy, OF_DRIVES.library)
    assert found.words == "joint 2's error depends on the payload"
    assert found.unlisted > 0.95

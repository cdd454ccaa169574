"""Recordings of one robot that no one fit can hold: sections of one verdict, each kind jointly."""

import json
from dataclasses import replace

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from plumbline.experiments.report.writing import report_html
from plumbline.kinematics.tree import tree_of
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.of_recordings import Carries, OfRecording
from plumbline.optim.diagnosis.proof import proofs
from plumbline.optim.diagnosis.several.motions import beyond_its_noise, joined_motions
from plumbline.optim.diagnosis.several.sections import refuse_unlike
from plumbline.optim.diagnosis.verdict.words import left_over
from plumbline.optim.recording.session import build_session, joined
from tests.motions import ROWS, arm, recorded

DRY, NOISE = 0.8, np.array([0.2, 0.1])  # [N m]
PLAYS = (0.01, 0.02)  # [rad] of joint 2, in one motion and in the other
SCALE = 3e-3  # of joint 2's reading


def efforts(seed, name, *, times=1.0, rows=60):
    """Efforts of the arm, whose second drive rubs; noise so many times as large."""
    rng = np.random.default_rng(seed)
    t, w = np.arange(rows) / 50.0, 2 * np.pi * rng.uniform(0.4, 1.1, 2)
    q, v = 0.7 * np.sin(np.outer(t, w)), 0.7 * w * np.cos(np.outer(t, w))
    tau = tree_of(arm()).dynamics.torques(q, v, -(w**2) * q)
    tau[:, 1] += DRY * np.sign(v[:, 1])
    return plumbline.build_recording(
        observation="joint_torque", robot=arm(), q=q, velocity=v, acceleration=-(w**2) * q, time=t,
        measured=tau + rng.normal(0.0, times * NOISE, tau.shape), noise_by_joint=times * NOISE,
        name=name,
    )  # fmt: skip


def tips(rows=30):
    rng = np.random.default_rng(3)
    q = rng.uniform(-1.5, 1.5, (rows, 2))
    seen = arm().chain().tips(q * [1.0, 1.0 + SCALE], np.zeros(3))
    return plumbline.build_recording(
        observation="tip_position", robot=arm(), q=q, noise_std=1e-4, name="tips",
        measured=seen + rng.normal(0.0, 1e-4, seen.shape),
    )  # fmt: skip


@pytest.fixture(scope="module")
def motions():
    return [
        replace(recorded(({"delay": 0.05}, {"play": play}), seconds=8.0, seed=k), name=f"m{k}")
        for k, play in enumerate(PLAYS)
    ]


@pytest.fixture(scope="module")
def both():
    return [efforts(1, "calm"), efforts(2, "loud", times=3.0)]


@pytest.fixture(scope="module")
def answer(motions, both):
    return plumbline.diagnose([*motions, *both, tips()])


def test_each_kind_is_a_section_with_its_own_causes(answer):
    kinds = [one.recording.observation for one in answer.sections]
    assert kinds == ["tip_position", "joint_torque", "motion"]
    assert [one.gap.unit for one in answer.sections] == ["m", "N m", "rad"]
    assert [c.effect for one in answer.sections[:2] for c in one.causes] == [
        "joint_scale", "coulomb_friction",
    ]  # fmt: skip
    assert {c.effect for c in answer.sections[2].causes} >= {"actuation_delay", "actuation_play"}
    assert answer.causes == tuple(c for one in answer.sections for c in one.causes)
    assert answer.gap == answer.sections[0].gap
    assert [one.verdict.verdict for one in answer.sections][2] == Outcome.PARTLY
    assert answer.verdict.verdict == Outcome.PARTLY, "the least settled is that of all"


def test_efforts_of_several_recordings_are_fitted_together_each_with_its_noise(answer, both):
    section = answer.sections[1]
    dry = section.causes[0].parameters["dry"]
    assert dry.value == pytest.approx(DRY, abs=4 * dry.std)
    calm, loud = section.verdict.recordings
    for r, one in zip((calm, loud), both, strict=True):
        assert r.noise == pytest.approx(np.sqrt(np.mean(one.noise_by_joint**2)))
        assert r.after == pytest.approx(r.noise, rel=0.15)
        assert r.without_it == pytest.approx(r.after, rel=0.1)
    alone = section.verdict.transfer[0].parameters["dry"]
    assert section.verdict.transfer[0].carries == Carries.YES
    # What is three times as noisy weighs a ninth.
    assert alone.others_std == pytest.approx(3 * alone.std, rel=0.25)
    assert dry.std == pytest.approx(np.sqrt(0.9) * alone.std, rel=0.1)


def test_efforts_are_weighed_by_their_recording_s_noise(both):
    whole = joined(build_session(both))
    own = whole.noise_by_joint * whole.noise_shape
    np.testing.assert_allclose(own[:60], np.tile(NOISE, (60, 1)))
    np.testing.assert_allclose(own[60:], np.tile(3 * NOISE, (60, 1)))
    alike = joined(build_session([both[0], efforts(4, "other")]))
    assert alike.noise_shape is None


def test_what_differs_between_motions_is_told(answer):
    section = answer.sections[2]
    table = {(t.effect, t.recording): t for t in section.verdict.transfer}
    assert table["actuation_delay", "m0"].carries == Carries.YES
    play = table["actuation_play", "m0"]
    assert play.carries == Carries.NO
    (value,) = play.parameters.values()
    assert (value.value, value.others) == pytest.approx(PLAYS, rel=0.05)
    here = section.verdict.recordings[0]
    assert here.without_it == pytest.approx(here.after, rel=0.05), "each fold leaves one out"


def test_several_sections_are_stored_shown_and_taken_home(answer, tmp_path):
    answer.save(tmp_path / "all.json")
    assert plumbline.load(tmp_path / "all.json").to_dict() == answer.to_dict()
    told = json.loads(json.dumps(answer.to_dict()))
    assert [s["gap"]["unit"] for s in told["sections"]] == ["m", "N m", "rad"]
    page = report_html(answer, proof=False)
    for words in ("3 kinds of recordings", "joint_torque", "N m", "What carries over"):
        assert words in page
    assert answer.model().observation == "tip_position"
    assert answer.model("loud").tau(np.zeros(2), [0.0, 1.0], np.zeros(2)).shape == (1, 2)
    assert answer.model("m1").law == "position"
    with pytest.raises(PlumblineError, match="found 'calmer', expected one of them; best matches"):
        answer.model("calmer")


def test_a_third_recording_is_tried_with_the_section_of_its_kind(answer, motions):
    assert answer.transfer(efforts(5, "third")).holds
    assert answer.transfer(tips()).unit == "m"
    assert answer.transfer(motions[0]).unit == "rad"


def test_what_is_not_of_one_robot_is_refused(motions, both):
    other = replace(motions[1], kp=motions[1].kp + 1.0)
    with pytest.raises(PlumblineError, match="m1, kp"):
        joined_motions([motions[0], other])
    with pytest.raises(PlumblineError, match="given twice"):
        joined_motions([motions[0], motions[0]])
    longer = [row | {"a": row["a"] + 0.1} for row in ROWS]
    moved = replace(motions[0], robot=plumbline.Robot.from_dh(longer))
    unlike = "m0, robot: found joints placed or turning otherwise, expected"
    with pytest.raises(PlumblineError, match=unlike):
        plumbline.diagnose([tips(), moved])
    more = replace(motions[0], robot=plumbline.Robot.from_dh([*longer, longer[-1]]))
    with pytest.raises(PlumblineError, match=unlike):
        refuse_unlike([tips(), replace(more, joints=tuple(more.robot.model.names[1:]))])


def test_kinds_may_speak_of_some_joints_of_the_robot_alone(motions):
    longer = plumbline.Robot.from_dh([*ROWS, ROWS[-1]])
    refuse_unlike([tips(), replace(motions[0], robot=longer, joints=tuple(longer.model.names[1:]))])


def test_a_recording_that_states_too_little_noise_is_named():
    said = {"observation": "tip_position", "rows": 30, "unit": "m", "before": 3e-3}
    said |= {"without_it": 2e-3, "noise": 1e-4, "noise_source": "given"}
    far = OfRecording(name="loud", after=1e-3 * np.sqrt(3.0), **said)
    assert beyond_its_noise(far, tips()).startswith("loud is missed by 10 times the noise that it")
    near = replace(far, after=1.9e-4 * np.sqrt(3.0))
    estimated = replace(far, noise_source="fit")
    assert beyond_its_noise(near, tips()) == beyond_its_noise(estimated, tips()) == ""
    assert left_over(beyond_its_noise(far, tips())).startswith("what is left: loud is missed")


def test_what_was_not_judged_is_said_in_the_headline(answer):
    verdict = replace(answer.sections[0].verdict, unjudged="3 targets")
    assert verdict.headline.endswith("; not judged: 3 targets")
    assert verdict.meaning.endswith(" Not judged: 3 targets.")
    assert "unjudged" not in answer.sections[0].to_dict()


def test_exported_files_alone_foretell_rows_that_no_fit_has_seen(answer):
    """A joint's scale is no matter of links: the readings are told."""
    found = {p.file: p for p in proofs(answer.sections[0])}
    links, corrected = found["URDF"], found["URDF, readings corrected"]
    noise = np.sqrt(3.0) * 1e-4
    assert links.after > 5 * noise
    assert links.lacks.startswith("cannot hold joint_scale 2")
    assert corrected.after < 1.5 * noise
    assert corrected.rows + 20 <= 30


def test_efforts_and_motions_are_proven_by_files_that_mujoco_reads(answer, both):
    pytest.importorskip("mujoco")
    motion = proofs(answer.sections[2])
    assert [(p.file, p.reader, p.unit) for p in motion] == [("MJCF", "MuJoCo", "rad")]
    assert motion[0].after < 0.4 * motion[0].before
    efforts = proofs(plumbline.diagnose(both[0]))
    assert [p.reader for p in efforts] == ["Pinocchio", "MuJoCo"]
    for p in efforts:
        assert p.after == pytest.approx(np.sqrt(np.mean(NOISE**2)), rel=0.25)
        assert p.before > 2 * p.after


def test_the_report_that_is_written_holds_the_proof(answer, tmp_path):
    plumbline.write_report(answer.sections[0], tmp_path / "one.html")
    words = "What exported files alone say"
    assert words in (tmp_path / "one.html").read_text()
    assert words not in report_html(answer.sections[0], proof=False)
    assert proofs(replace(answer.sections[0], verdict=replace(answer.verdict, causes=()))) == ()

"""What no robot with a right set-up leaves is no noise: it is never `no-gap`, never `explained`."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import NoiseLevel, Outcome
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.verdict.judge import _missed
from plumbline.optim.diagnosis.verdict.lack_of_fit import implausible_noise, quieter
from plumbline.optim.recording import set_up
from plumbline.optim.recording.building import build_recording
from tests.benches import readings
from tests.few_effects import FEW_EFFECTS
from tests.optim.recording.test_set_up import room, told, turned

SURE = (Outcome.NO_GAP, Outcome.EXPLAINED)
ZEROS = DiagnosisOptions(library=(JointOffset, JointScale), force=True)


def shuffled_sockets(given):
    return told(given, socket=np.random.default_rng(2).permutation(given["socket"]))


def random_joints(given):
    return told(given, q=readings(given["robot"].chain(), len(given["q"]), 9))


def turned_signs(given):
    return told(given, q=turned(given["q"], 2, 3))


@pytest.mark.parametrize("nonsense", [shuffled_sockets, random_joints, turned_signs])
def test_nonsense_in_sockets_is_a_gap_and_says_so(nonsense):
    """Noise is not stated: without a limit all of it would be taken for noise."""
    verdict = diagnose(nonsense(room("fixed_point", "ur5")), ZEROS).verdict
    assert verdict.verdict not in SURE
    assert verdict.outside_probability == 1.0
    assert "and no set-up that is right leaves more than 13.5 mm" in " ".join(verdict.notes)


@pytest.mark.parametrize("stated", [None, 0.1])
def test_tips_of_other_rows_are_no_noise_even_if_they_are_stated_to_be(stated):
    given = room("tip_position", "bh7")
    rows = np.random.default_rng(0).permutation(len(given["q"]))
    recording = told(given, measured=given["measured"][rows], noise_std=stated)
    assert diagnose(recording, ZEROS).verdict.verdict not in SURE


def test_a_noise_that_no_device_has_says_as_much_as_none():
    given = room("tip_position", "bh7")
    most = set_up.plausible(told(given))
    coarse, fine = (told(given, noise_std=share * most) for share in (1.01, 0.99))
    assert "is coarse" not in " ".join(fine.notes)
    assert "is coarse; is it in m?" in " ".join(coarse.notes)
    plain, verdict = (diagnose(r, ZEROS).verdict for r in (told(given), coarse))
    assert (verdict.verdict, verdict.noise) == (plain.verdict, plain.noise)


@pytest.mark.parametrize("times", [3.0, 10.0])
def test_a_gap_does_not_hide_in_a_stated_noise_that_rows_belie(times):
    """Joint 2's zero is 2 mrad off, a misfit of a millimetre; the noise is a tenth of that."""
    given = room("tip_position", "ur5", noise=1e-4, off=2e-3 * np.eye(6)[1])
    verdict = diagnose(told(given, noise_std=times * 1e-3), FEW_EFFECTS).verdict
    assert [(c.effect, c.element) for c in verdict.causes] == [("joint_offset", 2)]
    assert verdict.verdict == Outcome.PARTLY
    assert "but rows miss the model by" in verdict.notes[-1]


@pytest.mark.parametrize(("times", "said"), [(1.0, False), (1.25, False), (1.6, True)])
def test_a_noise_that_is_stated_too_large_is_said_to_be(times, said):
    """A stated one is known to 16 %: what is left is below it by chance in one of a hundred."""
    ratio = NoiseLevel(times * 1e-4, "given", 1.0 / times)
    assert bool(list(quieter(ratio, 1000.0, "m"))) == said
    assert not list(quieter(replace(ratio, source="fit"), 1000.0, "m"))
    assert not list(quieter(ratio, 3.0, "m"))  # readings so few tell no size


def test_encoders_that_read_anything_are_no_noise():
    given = room("joint_position", "bh7")
    read = given["measured"] + np.random.default_rng(0).normal(0.0, 0.1, given["q"].shape)
    assert diagnose(told(given, measured=read), ZEROS).verdict.verdict not in SURE


def test_the_limit_is_a_hundredth_of_the_reach():
    given = room("tip_position", "bh7", noise=0.0)
    chain = given["robot"].chain()
    noise = np.random.default_rng(0).normal(0.0, chain.reach, given["measured"].shape)
    kinds = [
        diagnose(told(given, measured=given["measured"] + share * noise), ZEROS).verdict.verdict
        for share in (0.006, 0.016)
    ]
    assert kinds == [Outcome.NO_GAP, Outcome.OUTSIDE]


def test_a_drift_that_rows_left_out_do_not_foretell_is_no_noise_of_theirs():
    """Only of causes that run with time may rows left out be missed by so much."""
    recording = told(room("tip_position", "bh7"))
    noise = NoiseLevel(1e-4, "fit", 1.0)

    class Missed:
        rms_after, per_point = 3.0, 1.0

    assert implausible_noise(recording, noise, Missed, timed=True) == 0.0
    assert implausible_noise(recording, noise, Missed, timed=False) == 3.0
    given = replace(noise, source="given")
    assert implausible_noise(recording, given, Missed, timed=False) == 0.0
    assert set_up.constants.PLAUSIBLE == 0.01


def test_an_encoder_s_limit_is_an_angle():
    recording = told(room("joint_position"))
    assert set_up.plausible(recording) == 0.01
    tips = told(room("tip_position"))
    assert set_up.plausible(tips) == pytest.approx(0.01 * tips.reach)


def test_an_instrument_whose_slide_has_no_limits_reaches_as_far_as_it_was_slid():
    """Its links are centimetres long: of those alone a camera's tenths of a millimetre are none."""
    dh = [{"alpha": np.pi / 2}, {"alpha": -np.pi / 2}, {"kind": "prismatic"}, {"a": 0.01}]
    robot = Robot.from_dh([{"a": 0.0, "alpha": 0.0} | row for row in dh])
    q = np.random.default_rng(0).uniform(-0.7, 0.7, (20, 4))
    q[:, 2] = np.linspace(0.05, 0.2, 20)
    tips = robot.chain().tips(q, np.zeros(3))
    recording = build_recording(robot=robot, observation="tip_position", q=q, measured=tips)
    assert recording.reach == pytest.approx(0.01 + 0.2)
    assert set_up.plausible(recording) == pytest.approx(0.01 * recording.reach)


@pytest.mark.parametrize(("share", "said"), [(0.0005, False), (0.003, True)])
def test_what_is_large_and_taken_for_noise_is_said_to_be(share, said):
    """From a thousandth of the reach on: a tracker's noise is far below."""
    given = room("tip_position", "bh7", noise=0.0)
    noise = np.random.default_rng(0).normal(0.0, 1.0, given["measured"].shape)
    noisy = given["measured"] + share * given["robot"].chain().reach * noise
    verdict = diagnose(told(given, measured=noisy), ZEROS).verdict
    assert verdict.verdict == Outcome.NO_GAP
    assert ("taken for noise, since none is stated" in " ".join(verdict.notes)) == said


@pytest.mark.parametrize(
    ("ratio", "formless", "source", "words"),
    [
        (1.5, None, "given", "noise larger than stated: 0.0600 mm an axis, 1.5 times noise_std"),
        (2.1, True, "given", "what is left is 2.1 times the noise that is stated and follows no"),
        (1.0, False, "given", "rows left out are missed by 2.5 times their noise: too few rows"),
        (2.1, False, "given", None),  # what it follows is in the tree
        (2.1, False, "fit", None),
    ],
)
def test_noise_that_is_stated_too_small_is_told_from_rows_that_are_too_few(
    ratio, formless, source, words
):
    gap = SimpleNamespace(after=2.5e-4, noise_floor=1e-4, unit="m", is_far=True)
    said = list(
        _missed(
            gap, NoiseLevel(4e-5, source, ratio), formless=bool(formless), noisier=formless is None
        )
    )
    assert [s.startswith(words) for s in said] == [True] if words else not said

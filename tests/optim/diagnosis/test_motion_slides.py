"""Joints that slide are read in metres, and never counted as radians beside those that turn."""

import numpy as np
import pytest

from plumbline import build_motion, diagnose
from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.motion.constants import AXIS_LEVER
from plumbline.optim.diagnosis.motion.units import in_unit
from plumbline.optim.diagnosis.options import DiagnosisOptions
from tests.motions import multisine, servo

NOISE = np.array([3e-4, 3e-4, 3e-5])  # [rad], [rad], [m]
SHIFTS = np.array([0.0, 0.0, 0.12])  # where each joint swings about
SPANS = np.array([1.0, 1.0, 0.1])


def instrument():
    rows = [{"alpha": np.pi / 2}, {"alpha": -np.pi / 2}, {"alpha": 0.0, "kind": "prismatic"}]
    return Robot.from_dh([{"a": 0.0} | row for row in rows])


def driven(play=0.001):
    """A shaft that turns, tilts and slides; the slide has a millimetre of play to either side."""
    t, turns = multisine(12.0, 0.01)
    u = SHIFTS + SPANS * np.column_stack([turns[:, :2], turns[::-1, :1]])
    q = np.column_stack([servo(t, u[:, j], lag=0.05, play=play * (j == 2)) for j in range(3)])
    return t, u, q + NOISE * np.random.default_rng(0).normal(size=q.shape)


@pytest.fixture(scope="module")
def answer():
    t, u, q = driven()
    return diagnose(build_motion(robot=instrument(), time=t, command=u, q=q, kind="position"))


def test_play_of_a_slide_is_in_metres_and_its_size_is_right(answer):
    causes = {(c.effect, c.element): c for c in answer.verdict.causes}
    half = causes["actuation_play", 3].parameters["half_play"]
    assert half.unit == "m"
    assert half.value == pytest.approx(0.001, rel=0.05)
    assert answer.model().parameters["actuation_play 3"].unit == "m"


def test_every_joint_s_gap_is_in_its_own_unit_and_all_together_in_radians(answer):
    each = answer.verdict.joints
    assert [joint.unit for joint in each] == ["rad", "rad", "m"]
    before, after = (
        np.array([getattr(joint, side) for joint in each]) / [1.0, 1.0, AXIS_LEVER]
        for side in ("before", "after")
    )
    assert answer.gap.unit == "rad"
    assert answer.gap.before == pytest.approx(np.sqrt(np.mean(before**2)), rel=1e-9)
    assert answer.gap.after == pytest.approx(np.sqrt(np.mean(after**2)), rel=1e-9)
    assert any("a slide's metres are divided by 0.1 m" in note for note in answer.verdict.notes)
    tried = answer.model().tried(answer.recording)
    assert tried.before == pytest.approx(answer.gap.before, rel=0.1)


@pytest.mark.parametrize(
    ("turning", "sliding"),
    [
        ("rad", "m"), ("rad/s", "m/s"), ("rad/s^2", "m/s^2"), ("s", "s"), ("1", "1"),
        ("N m", "N"), ("N m s/rad", "N s/m"), ("kg m^2", "kg"), ("rad/(N m)", "m/N"),
    ],
)  # fmt: skip
def test_what_drives_have_of_a_slide_is_in_a_slide_s_units(turning, sliding):
    assert in_unit(turning, "m") == sliding
    assert in_unit(turning, "rad") == turning


def test_a_stated_noise_is_each_joint_s_in_its_own_unit():
    """Asked of no effect at all, which is an answer, too."""
    t, u, q = driven(play=0.0)
    few = slice(0, 400)
    stated = DiagnosisOptions(without=tuple(e.name for e in MOTION_EFFECTS))
    given = {"time": t[few], "command": u[few], "q": q[few], "noise_std": 1e-4}
    noise = diagnose(
        build_motion(robot=instrument(), kind="position", **given), stated
    ).verdict.noise
    levers = np.array([1.0, 1.0, AXIS_LEVER])
    assert noise.sigma == pytest.approx(1e-4 * np.sqrt(np.mean(levers**-2.0)), rel=1e-9)


@pytest.mark.parametrize("share", [1.0, 0.05])
def test_millimetres_of_a_slide_are_refused(share):
    """Of a slide that goes by millimetres alone, too: no arm is too small for these metres."""
    t, u, q = driven(play=0.0)
    u[:, 2], q[:, 2] = share * (u[:, 2] - 0.12), 1e3 * share * (q[:, 2] - 0.12)
    with pytest.raises(PlumblineError, match="q3"):
        build_motion(robot=instrument(), time=t, command=u, q=q, kind="position")

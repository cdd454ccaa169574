"""Laws of readings in the robot's base frame, whose frame is known and not fitted."""

import numpy as np
import pytest

from plumbline.kinematics.effects.respiration import Respiration
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.building import build_recording
from tests.few_effects import FEW_EFFECTS
from tests.simulated_cases import causes

NOISE = 1e-4
TOOL = (0.0, 0.02, 0.1)
BASE = np.eye(3)
AWAY = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def read(factor=1.0, offset=0.0, R_device_base=BASE, always=("tool",), **given):
    """60 tips of a UR5 whose joint 2 turns too far and whose joint 1 stands elsewhere."""
    rng = np.random.default_rng(3)
    robot = Robot.bundled("ur5")
    q = rng.uniform(-1.5, 1.5, (60, 6))
    turned = q * [1.0, factor, 1.0, 1.0, 1.0, 1.0] + offset * np.eye(6)[0]
    y = robot.chain().tips(turned, TOOL) @ R_device_base.T + rng.normal(0.0, NOISE, (60, 3))
    return build_recording(
        observation="tip_position", robot=robot, q=q, measured=y, tool_offset=TOOL,
        noise_std=NOISE, always=always, time=10.0 * np.arange(60.0), **given,
    )  # fmt: skip


@pytest.mark.parametrize("always", [("tool",), ()])
def test_a_known_frame_hides_no_part_of_the_gap(always):
    """A match of the tips would have turned it so that joint 2 is blamed for less."""
    found = diagnose(read(factor=1.002, always=always), FEW_EFFECTS)
    assert causes(found) == [("joint_scale", 2)]
    assert found.verdict.verdict == "explained"
    estimate = found.verdict.causes[0].parameters["gain"]
    assert estimate.value == pytest.approx(0.002, abs=4 * estimate.std)


def test_a_known_frame_with_nothing_wrong_has_no_gap():
    assert diagnose(read()).verdict.verdict == "no-gap"


def test_a_breath_whose_every_row_falls_into_one_phase_is_not_looked_for():
    """It would be a mere shift of all readings."""
    turns = np.array([10.0 * e.frequency for e in Respiration.candidates(scope_of(read()))])
    assert len(turns) > 100
    assert np.abs(turns - np.round(turns)).min() > 1e-4


def test_in_a_known_frame_the_first_joint_can_stand_elsewhere():
    assert causes(diagnose(read(offset=1e-3), FEW_EFFECTS)) == [("joint_offset", 1)]


def test_readings_that_are_not_in_the_base_frame_have_theirs_fitted_and_it_is_said():
    recording = read(R_device_base=AWAY)
    assert recording.always == ("frame", "tool")
    [note] = recording.notes
    assert "leaves out frame" in note
    assert read().notes == ()
    assert nuisances_of(read()).size == 3

"""Commands where place and orientation cannot both be had, and where a joint remembers its path."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.robot import Robot
from plumbline.optim.model import Model

Q = np.array([0.4, -1.2, 0.9, 0.1, 0.6, 0.0])


@pytest.fixture(scope="module")
def arm():
    """A UR5 without any effect."""
    robot = Robot.bundled("ur5")
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (30, 6))
    none = np.zeros(3)
    return Model(
        recording="made up",
        observation="tip_position",
        robot=robot,
        tip_frame=robot.default_tip,
        effects=(),
        values=np.empty(0),
        covariance=np.empty((0, 0)),
        nuisance_names=(),
        always=(),
        T_device_base=np.eye(4),
        centre=none,
        tool_offset=none,
        tool=np.array([0.0, 0.0, 0.2]),
        R_tip_tool=np.eye(3),
        sockets={},
        samples={"q": q},
        ranges={"q": np.array([q.min(axis=0), q.max(axis=0)])},
    )


def test_where_a_pose_cannot_be_had_its_place_is_kept(arm):
    """A stretched arm that is to point its tool back at itself."""
    q = np.random.default_rng(4).uniform(-1.2, 1.2, (12, 6))
    q[:, 2:] *= 0.1
    goal = arm.nominal.placement(q)
    goal[:, :3, :3] = np.diag([1.0, -1.0, -1.0]) @ goal[:, :3, :3]
    command = arm.joint_command_for(goal)
    assert (command.turned > 0.1).sum() > 3
    assert command.reached.all()
    np.testing.assert_allclose(arm.tip(command.q), goal[:, :3, 3], atol=1e-6)


def test_a_mirrored_pose_is_refused(arm):
    with pytest.raises(PlumblineError, match="pose: found axes that are mirrored"):
        arm.joint_command_for(np.diag([1.0, 1.0, -1.0, 1.0]))


def test_one_posture_of_a_joint_that_lags_is_commanded_by_the_way_it_came(arm):
    lag = REGISTRY["hysteresis"](joint=2, width=1e-3)
    arm = replace(arm, effects=(lag,), values=np.array([1e-3]), covariance=np.zeros((1, 1)))
    for side in (-1.0, 1.0):
        way = side * np.eye(6)[1]
        behind = arm.joint_corrections(Q, direction=way)[0, 1]
        np.testing.assert_allclose(behind, -0.5e-3 * side, atol=1e-12)
        command = arm.joint_command(Q, direction=way)
        np.testing.assert_allclose(command.q[0, 1] - Q[1], 0.5e-3 * side, atol=1e-6)


def test_a_path_that_begins_with_no_known_way_begins_in_the_middle_of_its_play(arm):
    lag = REGISTRY["hysteresis"](joint=2, width=1e-3)
    arm = replace(arm, effects=(lag,), values=np.array([1e-3]), covariance=np.zeros((1, 1)))
    assert arm.joint_corrections(Q)[0, 1] == 0.0


def test_a_pose_of_the_arm_is_found_from_postures_that_were_recorded(arm):
    goal = arm.nominal.placement(np.random.default_rng(6).uniform(-2.0, 2.0, (60, 6)))
    command = arm.joint_command_for(goal)
    assert command.reached.all()
    assert (command.turned < 1e-6).mean() > 0.9


def test_a_point_out_of_reach_is_come_as_near_to_as_the_arm_can(arm):
    goal = np.array([[1.5, 0.3, 0.2], [-0.4, 1.2, 0.6], [0.2, -0.3, 1.9]])
    command = arm.joint_command_for(goal)
    for point, q, missed in zip(goal, command.q, command.missed, strict=True):
        best = least_squares(lambda x, to=point: arm.tip(x)[0] - to, q, xtol=1e-12, ftol=1e-12)
        assert 0.05 < missed < 1.001 * np.linalg.norm(best.fun)


def test_a_way_that_all_poses_share_is_one_for_each_joint(arm):
    """Of as many poses as there are joints, too."""
    play = REGISTRY["backlash"](joint=2)
    arm = replace(arm, effects=(play,), values=np.array([1e-3]), covariance=np.zeros((1, 1)))
    goal = arm.nominal.tip(np.random.default_rng(7).uniform(-1.0, 1.0, (6, 6)))
    goal[:2] *= 5.0  # out of reach: tried from every start
    way = np.array([0, 1, 0, 0, 0, -1])
    shared, each = (arm.joint_command_for(goal, direction=d) for d in (way, np.tile(way, (6, 1))))
    np.testing.assert_array_equal(shared.q, each.q)


@pytest.mark.parametrize(
    ("near", "words"),
    [
        (np.full(6, 7.0), "near, row 1, joint 1: found 7, expected -6.28319 to 6.28319"),
        (np.zeros((3, 6)), "near: found 3 postures, expected one, or 2; give one for each pose"),
    ],
)
def test_a_posture_to_stay_near_to_is_within_limits_and_one_for_each_pose(arm, near, words):
    with pytest.raises(PlumblineError, match=words):
        arm.joint_command_for(np.full((2, 3), 0.4), near=near)


@pytest.mark.parametrize("side", [2.0, 0.5])
def test_a_side_of_approach_is_one_of_three(arm, side):
    with pytest.raises(PlumblineError, match=f"model, direction: found {side:g}, expected -1, 0"):
        arm.tip(Q, direction=side)


@pytest.mark.parametrize("reading", [-2 * np.pi, 2 * np.pi, 7.0])
def test_readings_at_a_limit_and_beyond_are_corrected_as_any_others(arm, reading):
    ripple = REGISTRY["transmission_ripple"](joint=2)
    rippled = replace(
        arm, effects=(ripple,), values=np.array([3e-3, -2e-3]), covariance=np.zeros((2, 2))
    )
    q = np.array([0.0, reading, 0.3, 0.2, 0.1, 0.0])
    wave = 3e-3 * np.sin(reading) - 2e-3 * np.cos(reading)
    found = rippled.corrections_beyond_links(q)[0]
    np.testing.assert_allclose(found, [0.0, wave, 0.0, 0.0, 0.0, 0.0], atol=1e-6)

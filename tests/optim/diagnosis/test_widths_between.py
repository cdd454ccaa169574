"""A width that nobody tried is found, however far a gap stands out of the noise."""

import numpy as np
import pytest

from plumbline.kinematics.effects.hysteresis import lag_of_play
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.recording.building import build_recording

ROWS, NOISE = 400, np.array([1.0, 0.5])  # N m
FAR = 20.0  # noises, of friction at its largest
UNSURE = 0.05  # of something unlisted


def moved(seed):
    """Two joints that go to and fro: readings, rates (N, 2) and the clock (N,)."""
    rng, time = np.random.default_rng(seed), 0.02 * np.arange(ROWS)
    w, phase = rng.uniform(1.0, 4.0, (3, 2)), rng.uniform(0.0, 6.0, (3, 2))
    angle = w * time[:, None, None] + phase
    waves = 0.4 * np.sin(angle), 0.4 * w * np.cos(angle), -0.4 * w**2 * np.sin(angle)
    return rng, time, *(x.sum(axis=1) for x in waves)


def diagnosed(friction, seed):
    """A diagnosis of efforts with friction (N,) of joint 2, given its place and speed (N,)."""
    rng, time, q, v, a = moved(seed)
    link = {"d": 0.0, "a": 0.4, "alpha": 0.0, "mass": 3.0, "com": [-0.2, 0.0, 0.0]}
    robot = Robot.from_dh([link, link])
    tau = tree_of(robot).dynamics.torques(q, v, a) + NOISE * rng.normal(size=q.shape)
    tau[:, 1] += FAR * NOISE[1] * friction(q[:, 1], v[:, 1])
    recording = build_recording(
        observation="joint_torque", robot=robot, time=time, q=q, velocity=v, acceleration=a,
        measured=tau, noise_by_joint=NOISE,
    )  # fmt: skip
    return diagnose(recording)


@pytest.mark.parametrize("share", [0.043, 0.23])
def test_friction_that_falls_at_any_speed_is_listed(share):
    def creeping(_, v):
        return np.sign(v) * np.exp(-((v / (share * np.abs(v).max())) ** 2))

    answer = diagnosed(creeping, 2)
    assert [c.label for c in answer.causes] == ["stribeck_friction of drive 2"]
    assert answer.verdict.outside_probability < UNSURE


@pytest.mark.parametrize(("way", "start"), [(0.0085, 0.5), (0.013, -0.5), (0.04, 0.5)])
def test_friction_that_holds_over_any_way_is_listed(way, start):
    def held(q, _):
        return -2.0 * lag_of_play(q, way, start)  # wound up by nobody knows what

    answer = diagnosed(held, 3)
    assert [c.label for c in answer.causes] == ["coulomb_friction of drive 2"]
    assert answer.verdict.outside_probability < UNSURE

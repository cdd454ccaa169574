"""Rates beside the columns that they rate are what their names say, or are refused by name."""

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.recording.building import build_recording
from tests.random_trees import Tree

TIME = np.arange(0.0, 8.0, 0.01)


@pytest.fixture(scope="module")
def robot():
    return Robot.from_urdf(Tree(3, ("revolute",) * 3).urdf())


def columns(late=0.0):
    """Places, velocities so late [s] and accelerations (N, 3)."""
    w = 2 * np.pi * np.array([[0.21, 0.34, 0.47], [0.53, 0.71, 0.62]])
    own, after = (w * (TIME - by)[:, None, None] + w for by in (0.0, late))
    q, v, a = 0.5 * np.sin(own), 0.5 * w * np.cos(after), -0.5 * w**2 * np.sin(own)
    return [x.sum(axis=1) for x in (q, v, a)]


def recorded(robot, q, v, a):
    torques = tree_of(robot).dynamics.torques(*columns())
    read = torques + np.random.default_rng(0).normal(0.0, 0.02, q.shape)
    build_recording(
        observation="joint_torque", robot=robot, time=TIME, q=q, velocity=v, acceleration=a,
        measured=read, noise_by_joint=np.full(3, 0.02),
    )  # fmt: skip


def turned(x):
    return x * [1.0, -1.0, 1.0]


def exchanged(x):
    return x[:, [0, 2, 1]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda q, v, a: (q, turned(v), a), "column 'velocity2': .*against q2.*turn the sign"),
        (lambda q, v, a: (q, v, turned(a)), "'acceleration2': .*against velocity2.*turn the sign"),
        (lambda q, v, a: (q, exchanged(v), a), "velocity2 with q3, and velocity3 with q2.*exch"),
        (lambda q, v, a: (q, v, exchanged(a)), "acceleration2 with velocity3, and accel.*exch"),
        (lambda q, v, a: (v, v, a), "column 'velocity1': found velocity1 that runs with q1 itself"),
        (lambda q, v, a: (q, q, a), "column 'velocity1': found velocity1 that runs with q1 itself"),
        (lambda q, v, a: (q, a, a), "'acceleration1': .*that runs with velocity1 itself"),
    ],
)
def test_rates_that_are_not_what_their_names_say_are_refused(robot, change, words):
    with pytest.raises(PlumblineError, match=words):
        recorded(robot, *change(*columns()))


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("late", [0.0, 0.05, 0.19])
def test_rates_that_are_late_or_noisy_are_rates(robot, late, noise):
    q, v, a = columns(late)
    recorded(robot, q, v + np.random.default_rng(1).normal(0.0, noise, v.shape), a)

"""The joint posterior is of a problem that is linearised where the most probable state is."""

import numpy as np
import pytest

from plumbline import Robot, build_recording, diagnose

LINK = """<link name="{0}"><inertial><origin xyz="0 0.01 {1}"/><mass value="{2}"/>
<inertia ixx="{3}" iyy="{3}" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="j{0}" type="{1}"><parent link="{2}"/><child link="{0}"/>
<origin xyz="0 0 {3}"/><axis xyz="{4}"/>
<limit lower="-3" upper="3" effort="99" velocity="9"/></joint>"""


@pytest.fixture(scope="module")
def arm():
    links = [("a", 0.15, 3.0, 0.06), ("b", 0.1, 2.0, 0.02), ("c", 0.1, 0.8, 0.008)]
    joints = [
        ("a", "revolute", "base", 0.1, "0 1 0"),
        ("b", "revolute", "a", 0.3, "1 0 0"),
        ("c", "prismatic", "b", 0.1, "0 0 1"),
    ]
    parts = [LINK.format(*one) for one in links] + [JOINT.format(*one) for one in joints]
    return Robot.from_urdf(f'<robot name="three"><link name="base"/>{"".join(parts)}</robot>')


def swung(rng, rows=1200):
    """Places, rates and accelerations (rows, 3) of four sines a joint, and their clock [s]."""
    t = np.arange(rows) * 0.01
    q, v, a = np.zeros((3, rows, 3))
    for j in range(3):
        for _ in range(4):
            w, p = rng.uniform(0.5, 2.5), rng.uniform(0.0, 6.3)
            size = rng.uniform(0.2, 0.6) * (0.15 if j == 2 else 1.0) / (1.0 if w < 1.5 else 1.6)
            q[:, j] += size * np.sin(w * t + p)
            v[:, j] += size * w * np.cos(w * t + p)
            a[:, j] -= size * w * w * np.sin(w * t + p)
    return t, q, v, a


@pytest.mark.parametrize("seed", [4, 5])
def test_what_stood_in_for_something_unlisted_leaves_no_cause_at_another_drive(arm, seed):
    """A balancer about joint 2 was told as a heavier link, whose load drive 1 was to read less."""
    rng, noise = np.random.default_rng(seed), 0.09
    t, q, v, a = swung(rng)
    effort = arm.dynamics().torques(q, v, a)
    effort[:, 1] -= 8.0 * noise * np.sin(q[:, 1])
    effort += noise * rng.normal(size=effort.shape)
    verdict = diagnose(
        build_recording(
            observation="joint_torque", robot=arm, q=q, velocity=v, acceleration=a,
            measured=effort, time=t, noise_std=noise,
        )
    ).verdict  # fmt: skip
    assert verdict.outside_probability > 0.95
    assert all(c.probability < 0.5 for c in verdict.candidates)
    sure = [
        (place["stage"], place["element"]) for place in verdict.tree if place["probability"] > 0.5
    ]
    assert sure == [("actuation", 2)]

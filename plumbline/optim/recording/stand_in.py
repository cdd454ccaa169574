"""Stand-ins for an arm: what moves a flange or a point to where the file has it.

Three slides, and for poses three turns behind them (z, y, x), so that poses and points are joint
readings like any others. Nothing is blamed on them.
"""

import numpy as np
import scipy

from plumbline.errors import shown
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.constants import MOST_NAMED, SLIDE
from plumbline.optim.recording.table import Array

AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def points_robot() -> Robot:
    """What carries a point (3,) to its place: its joint readings are its coordinates [m]."""
    return _slides("points", "xyz", "")


def poses_robot() -> Robot:
    """What carries a flange to its pose: three slides, then turns about z, y and x."""
    return _slides("poses", "xyz", "zyx")


def pose_readings(T: Array) -> Array:
    """Joint readings (N, 6) [m, rad] of :func:`poses_robot` at poses (N, 4, 4)."""
    turns = scipy.spatial.transform.Rotation.from_matrix(T[:, :3, :3]).as_euler("ZYX")
    return np.hstack([T[:, :3, 3], turns])


def numbered(what: str, labels: tuple[str, ...]) -> tuple[str, ...]:
    """A note on which number is which label; none where labels are those numbers."""
    pairs = [(str(k), label) for k, label in enumerate(labels, start=1)]
    if all(number == label for number, label in pairs):
        return ()
    told = ", ".join(f"{number} is {shown(label)}" for number, label in pairs[:MOST_NAMED])
    return (f"{what} are counted from 1: {told}{', ...' * (len(pairs) > MOST_NAMED)}",)


def _slides(name: str, slides: str, turns: str) -> Robot:
    joints = [("prismatic", axis, SLIDE) for axis in slides]
    joints += [("revolute", axis, np.pi) for axis in turns]
    parts = [f'<robot name="{name}"><link name="link0"/>']
    for k, (kind, axis, most) in enumerate(joints, start=1):
        link = "tip" if k == len(joints) else f"link{k}"
        parts.append(
            f'<link name="{link}"/><joint name="joint{k}" type="{kind}">'
            f'<parent link="link{k - 1}"/><child link="{link}"/><axis xyz="{AXES[axis]}"/>'
            f'<limit lower="{-most}" upper="{most}" effort="1" velocity="1"/></joint>'
        )
    # Without weight: nothing of it bends.
    return Robot.from_urdf("".join([*parts, "</robot>"]), name=name, gravity=(0.0, 0.0, 0.0))

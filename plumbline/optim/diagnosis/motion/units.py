"""Units of places: a joint that turns is read in rad, one that slides, and a tip's axis, in m."""

from collections.abc import Sequence

import numpy as np

from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.motion.constants import AXIS_LEVER


def slides(robot: Robot, index: Sequence[int]) -> tuple[bool, ...]:
    """Which coordinates (n) of a robot's model are of joints that slide."""
    joints = {joint.idx_v: joint.shortname() for joint in robot.model.joints}
    return tuple("JointModelP" in joints.get(k, "") for k in index)


def sizes_of(sliding: Sequence[bool]) -> Array:
    """What a radian is in the unit of each place (n,)."""
    return np.where(sliding, AXIS_LEVER, 1.0)


def levers_of(sliding: Sequence[bool]) -> Array:
    """What each place is divided by (n,), to be told in one figure with all others.

    Metres never count as radians: beside joints that turn a slide's are counted as those of a tip
    so far from an axis. Where all slide they are metres.
    """
    return np.ones(len(sliding)) if all(sliding) else sizes_of(sliding)


def in_unit(unit: str, of_place: str) -> str:
    """A parameter's unit where places are metres: rad/s becomes m/s, a torque a force."""
    sliding = {"(N m)": "N", "N m": "N", "kg m^2": "kg", "rad": "m"} if of_place == "m" else {}
    for turning, other in sliding.items():
        unit = unit.replace(turning, other)
    return unit

r"""A Pinocchio model from standard DH rows (Denavit and Hartenberg 1955).

.. math:: T_{i-1,i} = R_z(\theta_i + q_i)\, T_z(d_i)\, T_x(a_i)\, R_x(\alpha_i)

A prismatic row adds q to d instead; a row of kind ``"fixed"`` has no q (a needle, a flange).
"""

from __future__ import annotations  # which would load Pinocchio before it is asked

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from plumbline.errors import PlumblineError, shown
from plumbline.kinematics.constants import LARGEST
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.oracle import pin

KINDS = ("revolute", "prismatic", "fixed")


@dataclass(frozen=True)
class DHRow:
    """One row of a standard DH table."""

    d: float = 0.0  # offset along the joint's axis [m]
    a: float = 0.0  # length of the common normal [m]
    alpha: float = 0.0  # twist about the common normal [rad]
    theta: float = 0.0  # offset of the joint's angle [rad]
    kind: str = "revolute"  # ``"revolute"``, ``"prismatic"`` or ``"fixed"``
    lower: float = -np.inf  # lower joint limit [rad or m]
    upper: float = np.inf  # upper joint limit [rad or m]
    mass: float = 0.0  # mass of the link [kg]
    # its centre of mass (3,) in the row's frame [m]
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def parse(cls, row: Mapping[str, object], number: int) -> Self:
        """From a table; ``number`` counts from 1, for the error (PlumblineError: it is no row)."""
        unknown = sorted(set(row) - set(cls.__dataclass_fields__))
        if unknown:
            known = ", ".join(cls.__dataclass_fields__)
            named = shown(unknown[0])
            raise PlumblineError(f"DH row {number}: key {named} not recognised; known: {known}")
        kind = row.get("kind", "revolute")
        if kind not in KINDS:
            named = shown(kind)
            raise PlumblineError(f"DH row {number}: kind {named} must be one of {', '.join(KINDS)}")
        keys = [key for key in row if key not in ("kind", "com")]
        numbers = {key: _number(row[key], key, number) for key in keys}
        parsed = cls(**numbers, kind=str(kind), com=_point(row.get("com", (0, 0, 0)), number))
        if parsed.lower > parsed.upper:
            limits = f"lower = {parsed.lower} exceeds upper = {parsed.upper}"
            raise PlumblineError(f"DH row {number}: {limits}; swap them")
        if parsed.mass < 0.0:
            raise PlumblineError(f"DH row {number}: mass = {parsed.mass} kg is below zero; mend it")
        return parsed

    def before(self) -> pin.SE3:
        """What precedes the joint's motion."""
        return pin.SE3(pin.utils.rotate("z", self.theta), np.zeros(3))

    def after(self) -> pin.SE3:
        """What follows the joint's motion."""
        twist = pin.utils.rotate("x", self.alpha)
        return pin.SE3(twist, np.array([self.a, 0.0, self.d]))


def _number(value: object, key: str, number: int) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool):
        # Compared before any conversion: a TOML integer may be too large for a float.
        unlimited = key in ("lower", "upper") and abs(value) == np.inf
        if -LARGEST <= value <= LARGEST or unlimited:
            return float(value)
    raise PlumblineError(f"DH row {number}: {key} = {shown(value)} must be a finite number")


def _point(value: object, number: int) -> tuple[float, float, float]:
    try:
        point = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        point = np.empty(0)
    if point.shape != (3,) or not (np.abs(point) <= LARGEST).all():
        found = shown(value)
        raise PlumblineError(f"DH row {number}: com = {found} must be three finite numbers [m]")
    return (float(point[0]), float(point[1]), float(point[2]))


def model_from_dh(rows: Sequence[DHRow], tip_frame: str) -> pin.Model:
    """The Pinocchio model of DH rows; every row's frame is an operational frame of it.

    Frames are called ``link1`` ... and, for the last row, ``tip_frame``.
    """
    model = pin.Model()
    parent, T = 0, pin.SE3.Identity()
    for number, row in enumerate(rows, start=1):
        T = T * row.before()
        if row.kind != "fixed":
            parent = _add_joint(model, parent, T, row, f"joint{number}")
            T = pin.SE3.Identity()
        T = T * row.after()
        if row.mass > 0.0:
            inertia = pin.Inertia(row.mass, np.array(row.com), np.zeros((3, 3)))
            model.appendBodyToJoint(parent, inertia, T)
        name = tip_frame if number == len(rows) else f"link{number}"
        model.addFrame(pin.Frame(name, parent, 0, T, pin.FrameType.OP_FRAME))
    return model


def _add_joint(model: pin.Model, parent: int, T: pin.SE3, row: DHRow, name: str) -> int:
    joint = pin.JointModelRZ() if row.kind == "revolute" else pin.JointModelPZ()
    big = np.array([np.inf])
    lower, upper = np.array([row.lower]), np.array([row.upper])
    added = int(model.addJoint(parent, joint, T, name, big, big, lower, upper))
    model.addJointFrame(added)
    return added


def rows_table(rows: Sequence[DHRow]) -> Array:
    """Columns d, a, alpha, theta (n, 4) [m, m, rad, rad]."""
    return np.array([[row.d, row.a, row.alpha, row.theta] for row in rows])

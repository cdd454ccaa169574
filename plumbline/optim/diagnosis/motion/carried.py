r"""A mass that a robot's file lacks, carried at its tip frame: part of what torques move.

Torques are linear in a body's ten numbers: mass m, first moment :math:`m c` and the inertia I about
a frame's origin (Atkeson, An, Hollerbach 1986, Int. J. Robotics Research 5(3)). At the tip frame a
mass is told by one of them where it sits there, by four where a point sits elsewhere,
:math:`I = m (c^T c\, 1 - c\, c^T)`, and by all ten where it is any body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from plumbline.kinematics.effects.payload import CarriedMass
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.parameters import Parameter
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.motion.constants import ASIDE, BODY, POINT

Motion = Any  # a MotionRecording, whose own module asks this one


@dataclass(frozen=True)
class Carried:
    """What the tip frame carries besides what the file states.

    Attributes:
        values: Mass, above nothing [kg]; if it sits elsewhere, mass times its centre's x, y and z
            in the tip frame [kg m]; if it is no point, inertia xx, yy, zz, xy, xz, yz about that
            [kg m^2].
    """

    values: tuple[float, ...] = ()

    @property
    def numbers(self) -> Array:
        """Mass, first moment, and inertia xx, xy, yy, xz, yz, zz about the tip frame (10,)."""
        given = np.zeros(BODY)
        given[: len(self.values)] = self.values
        mass, moment = given[0], given[1:4]
        xx, yy, zz, xy, xz, yz = given[4:]
        if len(self.values) == ASIDE:
            return np.array([mass, *moment, *_steiner(moment, moment) / mass])
        return np.array([mass, *moment, xx, xy, yy, xz, yz, zz])

    @property
    def declared(self) -> tuple[Parameter, ...]:
        """What its values are (P,), for an arm of one kilogram that reaches one metre."""
        return CarriedMass(True).declared[: len(self.values)]

    @property
    def form(self) -> str:
        """Where the mass sits, in a few words; nothing where it is told."""
        return {POINT: "at the tip frame", BODY: "a body of any inertia"}.get(len(self.values), "")

    @property
    def slopes(self) -> Array:
        """Derivatives of these numbers by the values (10, P)."""
        own = np.array(self.values)
        if not len(own):
            return np.zeros((BODY, 0))
        steps = np.eye(len(own)) * 1e-6
        both = ([Carried((*(own + s * one),)).numbers for one in steps] for s in (1, -1))
        ahead, behind = both
        return np.array([a - b for a, b in zip(ahead, behind, strict=True)]).T / 2e-6


NOTHING = Carried()


def _steiner(one: Array, other: Array) -> Array:
    r"""Of :math:`a \cdot b\, 1 - (a b^T + b a^T) / 2` xx, xy, yy, xz, yz, zz (6,)."""
    M = one @ other * np.eye(3) - (np.outer(one, other) + np.outer(other, one)) / 2
    return np.asarray(M[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])


def tip_of(robot: Robot) -> tuple[int, Array, Array]:
    """The joint that moves the tip frame, and where and how that lies there (3,) [m], (3, 3)."""
    there = [f for f in robot.model.frames if f.name == robot.default_tip and f.parentJoint > 0]
    frame = there[-1]
    return frame.parentJoint, np.array(frame.placement.translation), frame.placement.rotation


def from_tip(robot: Robot) -> Array:
    """What a body's numbers at the tip frame are at the joint that moves it (10, 10)."""
    _, place, R = tip_of(robot)
    found = np.zeros((BODY, BODY))
    found[0, 0], found[1:4, 0], found[4:, 0] = 1.0, place, _steiner(place, place)
    found[1:4, 1:4] = R
    for k in range(3):
        found[4:, 1 + k] = 2 * _steiner(place, R[:, k])
    rows, columns = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]
    for k, (i, j) in enumerate(zip(rows, columns, strict=True)):
        one = np.zeros((3, 3))
        one[i, j] = one[j, i] = 1.0
        found[4:, 4 + k] = (R @ one @ R.T)[rows, columns]
    return found


def model_of(r: Motion) -> pin.Model:
    """The robot's bodies under its gravity, with what its tip carries."""
    return weighed(r.robot, r.carried)


def weighed(robot: Robot, carried: Carried) -> pin.Model:
    """A copy of a robot's model under its gravity, with what its tip carries."""
    model = pin.Model(robot.model)
    model.gravity.linear = np.asarray(robot.gravity, dtype=float)
    if carried.values:
        joint = tip_of(robot)[0]
        own = model.inertias[joint].toDynamicParameters() if model.inertias[joint].mass else 0.0
        numbers = own + from_tip(robot) @ carried.numbers
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(numbers)
    return model

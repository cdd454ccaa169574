r"""Masses that a robot's file lacks: carried at its tip frame, or a link's that is not as it says.

Torques are linear in a body's ten numbers: mass m, first moment :math:`m c` and the inertia I about
a frame's origin (Atkeson, An, Hollerbach 1986, Int. J. Robotics Research 5(3)). At the tip frame a
mass is told by one of them where it sits there, by four where a point sits elsewhere,
:math:`I = m (c^T c\, 1 - c\, c^T)`, and by all ten where it is any body. A link is told by the
share that it weighs more, and by four numbers where its centre is elsewhere, too; its shape is its
file's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.link_inertia import LinkInertia
from plumbline.kinematics.effects.payload import CarriedMass
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.parameters import Parameter
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.motion.constants import ASIDE, BODY, POINT, ROUNDED_OFF

Motion = Any  # a MotionRecording, whose own module asks this one
ENTRIES = np.tril_indices(3)  # of an inertia among its numbers: xx, xy, yy, xz, yz, zz


@dataclass(frozen=True)
class Off:
    """A body that the file states otherwise, or not at all.

    Attributes:
        values: At the tip, mass above nothing [kg]; if it sits elsewhere, mass times its centre's
            x, y and z in the tip frame [kg m]; if it is no point, inertia xx, yy, zz, xy, xz, yz
            about that [kg m^2]. Of a link, mass more than stated as a share of it; if its centre
            is elsewhere, its shift along x, y and z of its joint [m].
        link: The joint that moves it, from 1; 0 for what the tip carries.
    """

    values: tuple[float, ...]
    link: int = 0

    @property
    def effect(self) -> type[Effect]:
        """The effect that it is."""
        return LinkInertia if self.link else CarriedMass

    @property
    def label(self) -> str:
        """Its effect, with the link's number if it has one."""
        return f"{self.effect.name} {self.link}" if self.link else self.effect.name

    @property
    def declared(self) -> tuple[Parameter, ...]:
        """What its values are (P,), for an arm of one kilogram that reaches one metre."""
        every = LinkInertia().declared if self.link else CarriedMass(True).declared
        return every[: len(self.values)]

    @property
    def form(self) -> str:
        """Where a mass at the tip sits, in a few words; nothing where it is told."""
        forms = {} if self.link else {POINT: "at the tip frame", BODY: "a body of any inertia"}
        return forms.get(len(self.values), "")

    def added(self, robot: Robot, index: Sequence[int]) -> tuple[int, Array]:
        """The joint that moves it, and what its numbers there (10,) are more than stated."""
        if not self.link:
            return tip_of(robot)[0], from_tip(robot) @ self.numbers
        joint = index[self.link - 1] + 1
        own = robot.model.inertias[joint]
        given = np.zeros(ASIDE)
        given[: len(self.values)] = self.values
        mass, centre = own.mass * (1 + given[0]), own.lever + given[1:] / (1 + given[0])
        about = own.inertia[ENTRIES] * (1 + given[0]) + mass * _steiner(centre, centre)
        return joint, np.array([mass, *(mass * centre), *about]) - own.toDynamicParameters()

    @property
    def numbers(self) -> Array:
        """At the tip, mass, first moment, and inertia xx, xy, yy, xz, yz, zz about it (10,)."""
        given = np.zeros(BODY)
        given[: len(self.values)] = self.values
        mass, moment = given[0], given[1:4]
        xx, yy, zz, xy, xz, yz = given[4:]
        if len(self.values) == ASIDE:
            return np.array([mass, *moment, *_steiner(moment, moment) / mass])
        return np.array([mass, *moment, xx, xy, yy, xz, yz, zz])


@dataclass(frozen=True)
class Carried:
    """All that a robot's joints move besides what its file states."""

    bodies: tuple[Off, ...] = ()

    @cached_property
    def values(self) -> tuple[float, ...]:
        """Those of all bodies, one after the other (P,)."""
        return tuple(v for body in self.bodies for v in body.values)

    def valued(self, values: Sequence[float] | Array) -> Carried:
        """The same bodies with other values (P,)."""
        left, bodies = [float(v) for v in values], []
        for body in self.bodies:
            count = len(body.values)
            bodies.append(replace(body, values=(*left[:count],)))
            left = left[count:]
        return Carried(tuple(bodies))

    def alike(self, other: Carried) -> bool:
        """Whether another is of the same bodies, told by as many values each."""
        mine, its = ([(b.link, len(b.values)) for b in one.bodies] for one in (self, other))
        return mine == its

    def without(self, body: Off) -> Carried:
        """All but one of them."""
        return Carried(tuple(one for one in self.bodies if one != body))

    def with_one(self, body: Off) -> Carried:
        """These and one more, the tip's first."""
        return Carried(tuple(sorted((*self.bodies, body), key=lambda one: one.link)))

    def numbers(self, robot: Robot, index: Sequence[int]) -> Array:
        """What each joint of the model moves more than stated (J, 10), at that joint."""
        found = np.zeros((robot.model.njoints - 1, BODY))
        for body in self.bodies:
            joint, more = body.added(robot, index)
            found[joint - 1] += more
        return found

    def is_real(self, robot: Robot, index: Sequence[int]) -> bool:
        """Whether every body that it changes is one: all its mass is above nothing, anywhere.

        Of a body's density the second moments about its centre are a positive matrix (Wensing, Kim,
        Slotine 2018, IEEE Robotics and Automation Letters 3(1):60), as those of a file that has
        points for links just are.
        """
        for joint, more in enumerate(self.numbers(robot, index), start=1):
            if more.any():
                own = robot.model.inertias[joint].toDynamicParameters()
                least, size = _least_moment(own + more)
                if not least >= min(_least_moment(own)[0], 0.0) - ROUNDED_OFF * size:
                    return False
        return True

    def slopes(self, robot: Robot, index: Sequence[int]) -> Array:
        """Derivatives of these by the values (P, J, 10)."""
        own, step = np.array(self.values), 1e-6
        found = np.zeros((len(own), robot.model.njoints - 1, BODY))
        for k, one in enumerate(step * np.eye(len(own))):
            ahead, behind = (self.valued(own + s * one).numbers(robot, index) for s in (1, -1))
            found[k] = (ahead - behind) / (2 * step)
        return found


NOTHING = Carried()


def _steiner(one: Array, other: Array) -> Array:
    r"""Of :math:`a \cdot b\, 1 - (a b^T + b a^T) / 2` xx, xy, yy, xz, yz, zz (6,)."""
    M = one @ other * np.eye(3) - (np.outer(one, other) + np.outer(other, one)) / 2
    return np.asarray(M[ENTRIES])


def _least_moment(numbers: Array) -> tuple[float, float]:
    """Least second moment of a body about its centre, and its inertia about the joint [kg m^2]."""
    mass, moment = numbers[0], numbers[1:4]
    inertia = np.zeros((3, 3))
    inertia[ENTRIES], inertia.T[ENTRIES] = numbers[4:], numbers[4:]
    size = float(np.abs(np.diagonal(inertia)).sum())
    if not np.isfinite(numbers).all() or mass <= 0.0:
        return (-np.inf if mass else 0.0), size
    about = inertia - mass * (moment @ moment * np.eye(3) - np.outer(moment, moment)) / mass**2
    return float(np.linalg.eigvalsh(np.trace(about) / 2 * np.eye(3) - about)[0]), size


@lru_cache(maxsize=16)
def tip_of(robot: Robot) -> tuple[int, Array, Array]:
    """The joint that moves the tip frame, and where and how that lies there (3,) [m], (3, 3)."""
    there = [f for f in robot.model.frames if f.name == robot.default_tip and f.parentJoint > 0]
    frame = there[-1]
    return frame.parentJoint, np.array(frame.placement.translation), frame.placement.rotation


@lru_cache(maxsize=16)
def from_tip(robot: Robot) -> Array:
    """What a body's numbers at the tip frame are at the joint that moves it (10, 10)."""
    _, place, R = tip_of(robot)
    found = np.zeros((BODY, BODY))
    found[0, 0], found[1:4, 0], found[4:, 0] = 1.0, place, _steiner(place, place)
    found[1:4, 1:4] = R
    for k in range(3):
        found[4:, 1 + k] = 2 * _steiner(place, R[:, k])
    for k, (i, j) in enumerate(zip(*ENTRIES, strict=True)):
        one = np.zeros((3, 3))
        one[i, j] = one[j, i] = 1.0
        found[4:, 4 + k] = (R @ one @ R.T)[ENTRIES]
    return found


def model_of(r: Motion) -> pin.Model:
    """The robot's bodies under its gravity, with what they are more than its file states."""
    return weighed(r.robot, r.index, r.carried)


def weighed(robot: Robot, index: Sequence[int], carried: Carried) -> pin.Model:
    """A copy of a robot's model under its gravity, with bodies that its file states otherwise."""
    model = pin.Model(robot.model)
    model.gravity.linear = np.asarray(robot.gravity, dtype=float)
    for joint, more in enumerate(carried.numbers(robot, index), start=1):
        if more.any():
            own = model.inertias[joint].toDynamicParameters()
            model.inertias[joint] = pin.Inertia.FromDynamicParameters(np.nan_to_num(own) + more)
    return model

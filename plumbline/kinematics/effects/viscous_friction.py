r"""Friction of a drive's grease, which grows with the speed.

.. math:: \tau_i \leftarrow \tau_i + b\,|\dot q_i|^{p}\,\mathrm{sign}\,\dot q_i, \qquad
          p \in \{1, \tfrac12\}

Strain-wave gears and warm grease thin out: their friction grows slower than the speed, about with
its root (Wolf, Iskandar 2018); the power is tried. In units of rad/s. In a motion
the drive works against it, :math:`I \ddot y = \ldots - b \dot y`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import casadi as cs

from plumbline.kinematics.effects.drive import DriveEffect
from plumbline.kinematics.effects.effect import Scope, State
from plumbline.kinematics.effects.motion_effect import INERT, MotionEffect
from plumbline.kinematics.parameters import Parameter

POWERS = (1.0, 0.5)


@dataclass(frozen=True)
class ViscousFriction(DriveEffect):
    """Friction in proportion to the ``power`` of the speed."""

    power: float = POWERS[0]

    depends_on = "velocity"
    name = "viscous_friction"
    words = "joint {element}'s drive works against friction that grows with its speed"
    reference = "Wolf, Iskandar (2018), IEEE ICRA (viscous friction that is not linear)"
    source = "by hand: as much as dry friction at 1 rad/s"
    viscous = Parameter("N m s/rad", 0.0, 10.0, scale=0.1, doc="friction per speed, at 1 rad/s")

    @property
    def variant(self) -> str:
        """Which power of the speed, if not the first."""
        return "" if self.power == POWERS[0] else "thinning: with the root of the speed"

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Self]:
        """Every joint, every power."""
        return [replace(e, power=p) for e in super().forms(scope) for p in POWERS]

    def apply(self, state: State, *values: cs.SX) -> State:
        v = state.row["velocity"][self.joint - 1]
        if self.power == POWERS[0]:
            return state.add_torque(self.joint, values[0] * v)
        speed = cs.fabs(v) ** self.power
        turning = state.row["turning"][self.joint - 1]
        return state.add_torque(self.joint, values[0] * speed * turning)


@dataclass(frozen=True)
class ViscousFrictionOfMotion(MotionEffect, of=ViscousFriction):
    """Grease that takes a share of the torque, in proportion to the speed."""

    term = "damping"
    reference = "Siciliano et al. (2009), Robotics, sec. 7.2 (viscous friction at the joints)"
    laws = INERT
    viscous = Parameter("N m s/rad", 0.0, 10.0, scale=0.1, doc="friction per speed, at 1 rad/s")

r"""Friction that falls as a drive gets going, before grease carries its teeth and balls.

.. math:: \tau_i \leftarrow \tau_i + s\,e^{-(\dot q_i/v_s)^2}\,\sigma(\dot q_i)

The speed :math:`v_s` is tried on a grid, as a share of the largest speed that was recorded.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import casadi as cs

from plumbline.kinematics.effects.drive import DriveEffect, largest_speed
from plumbline.kinematics.effects.effect import Effect, Scope, State
from plumbline.kinematics.parameters import Parameter, between

SHARES = (0.03, 0.1, 0.3)  # of the largest speed


@dataclass(frozen=True)
class StribeckFriction(DriveEffect):
    """What friction is more below ``speed`` [rad/s or m/s]."""

    speed: float = 0.1

    depends_on = "velocity"
    name = "stribeck_friction"
    words = "joint {element}'s drive works against more friction when it creeps"
    reference = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), sec. 2"
    source = "by hand: as dry friction"
    creeping = Parameter("N m", 0.0, 5.0, scale=0.1, doc="friction more when it hardly moves")

    @property
    def variant(self) -> str:
        """Where friction falls to its dry value."""
        return f"creeping below {self.speed:.3g} rad/s"

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Self]:
        """Every joint that moves, at several speeds."""
        speeds = [(e, largest_speed(scope, e.joint)) for e in super().forms(scope)]
        moving = [(e, fast) for e, fast in speeds if fast > 0]
        return [replace(e, speed=float(f"{s * fast:.2g}")) for e, fast in moving for s in SHARES]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Slower and faster."""
        return between(self, "speed", SHARES[-1] / SHARES[-2])

    def apply(self, state: State, *values: cs.SX) -> State:
        creeping = cs.exp(-((state.row["velocity"][self.joint - 1] / self.speed) ** 2))
        turning = state.row["turning"][self.joint - 1]
        return state.add_torque(self.joint, values[0] * creeping * turning)

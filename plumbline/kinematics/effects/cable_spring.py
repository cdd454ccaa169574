r"""A hose or cable dress that pulls a joint back, as a spring would.

.. math:: \tau_i \leftarrow \tau_i + k\,(q_i - q_{mid}) + p

about the middle of the angles that were recorded, where it pulls by p: nobody knows beforehand at
which angle a hose is slack.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import casadi as cs

from plumbline.kinematics.effects.drive import DriveEffect
from plumbline.kinematics.effects.effect import Scope, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class CableSpring(DriveEffect):
    """Torque in proportion to the angle from ``middle`` [rad or m]."""

    middle: float = 0.0

    depends_on = "own angle"
    name = "cable_spring"
    words = "joint {element} works against a spring, such as a hose or a cable"
    reference = "Khalil, Dombre (2002), Modeling, Identification and Control of Robots, ch. 12"
    source = "by hand: dress packs and springs of arms of 3 to 20 kg of payload"
    stiffness = Parameter("N m/rad", 0.0, 5.0, scale=0.05, doc="stiffness of the spring")
    pull = Parameter("N m", -5.0, 5.0, scale=0.05, doc="its pull at the middle of the angles")

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Self]:
        """Every joint that moves."""
        spans = [(e, *scope.span[f"q{e.joint}"]) for e in super().forms(scope)]
        return [
            replace(e, middle=float(f"{(low + high) / 2:.4g}"))
            for e, low, high in spans
            if high > low
        ]

    def apply(self, state: State, *values: cs.SX) -> State:
        away = state.q[self.joint - 1] - self.middle
        return state.add_torque(self.joint, values[0] * away + values[1])

r"""Friction winds a drive up against its motion.

.. math:: q_i \leftarrow q_i - (c + s\,e^{-(\dot q_i/v_s)^2})\,\mathrm{sign}\,\dot q_i - b\,\dot q_i

With dry friction c, what it is more when the joint hardly moves (s, after Stribeck), and viscous
friction b, each over the stiffness of the drive. The speed :math:`v_s` is tried on a grid. Without
s and b it is a backlash. Where the motor's effort was recorded, that shows friction as well, and
the drive's yielding under it is a ``joint_compliance``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.effect import Effect, JointEffect, Scope, State
from plumbline.kinematics.parameters import Parameter, between

SPEEDS = (0.03, 0.1, 0.3)


@dataclass(frozen=True)
class Friction(JointEffect):
    """Wind-up against the motion that depends on the speed."""

    speed: float = SPEEDS[1]

    depends_on = "direction"
    name = "friction"
    needs = ("velocity",)
    in_motion = True
    words = "joint {element}'s friction winds its drive up against the motion"
    reference = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7)"
    source = (
        "by hand, as play: what dry friction leaves a drive wound up by is no more than its play"
    )
    dry = Parameter("rad", 0.0, 2e-2, scale=5e-4, doc="wind-up by dry friction")
    slow = Parameter("rad", 0.0, 2e-2, scale=5e-4, doc="what it is more where the joint creeps")
    viscous = Parameter("s", 0.0, 2e-1, scale=5e-4, doc="wind-up per velocity")

    @property
    def variant(self) -> str:
        """Where friction falls to its dry value."""
        return f"creeping below {self.speed:.4g} rad/s"

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every joint of an arm that moves while it is measured."""
        return [cls(j, speed) for j in scope.joints for speed in SPEEDS]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Slower and faster."""
        return between(self, "speed", SPEEDS[1] / SPEEDS[0])

    def apply(self, state: State, *values: cs.SX) -> State:
        velocity = state.row["velocity"][self.joint - 1]
        creeping = cs.exp(-((velocity / self.speed) ** 2))
        drag = (values[0] + values[1] * creeping) * cs.sign(velocity) + values[2] * velocity
        return state.move_joint(self.joint, -drag)

r"""One joint moves another: a shared gearbox or tendon, :math:`q_i \leftarrow q_i + k\, q_j`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.effect import Effect, JointEffect, Scope, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class JointCoupling(JointEffect):
    """Joint ``joint`` moves in proportion to joint ``by``."""

    by: int = 2

    name = "joint_coupling"
    words = "joint {element} is dragged along by joint {by}"
    reference = "Veitschegger and Wu (1986), IEEE J. Robotics and Automation 2(3), sec. II"
    gain = Parameter("1", -0.05, 0.05, scale=5e-4, doc="travel per travel of the other joint")

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """Every ordered pair of joints."""
        if not cls.fits(scope):
            return []
        joints = range(1, scope.chain.n + 1)
        return [cls(joint=i, by=j) for i in joints for j in joints if i != j]

    def apply(self, state: State, *values: cs.SX) -> State:
        """Add a share of the other joint's reading."""
        return state.move_joint(self.joint, values[0] * state.reading_of_joint(self.by))

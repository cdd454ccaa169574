r"""One joint moves another: a shared gearbox or tendon, :math:`q_i \leftarrow q_i + k\, q_j`.

Where one of the two slides and the other turns, k is in metres per radian or the inverse.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.effects.effect import Effect, JointEffect, Scope, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class JointCoupling(JointEffect):
    """Joint ``joint`` moves in proportion to joint ``by``."""

    by: int = 2

    depends_on = "another joint's angle"
    name = "joint_coupling"
    words = "joint {element} is dragged along by joint {by}"
    reference = "Veitschegger and Wu (1986), IEEE J. Robotics and Automation 2(3), sec. II"
    source = (
        "width by hand: bevel wheels and cables that were meant to be compensated; range: cables "
        "that are not compensated at all drag a wrist's joint by up to the whole travel of the "
        "other"
    )
    gain = Parameter("1", -1.5, 1.5, scale=5e-4, doc="travel per travel of the other joint")

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every ordered pair of joints."""
        return [cls(i, j) for i in scope.joints for j in scope.joints if i != j]

    def unit_of(self, parameter: Parameter, chain: Chain) -> str:
        """A ratio of joints of one kind; of a slide and a joint that turns m/rad or rad/m."""
        dragged, other = (chain.kinds[j - 1] for j in (self.joint, self.by))
        if dragged == other:
            return parameter.unit
        return "m/rad" if dragged == "prismatic" else "rad/m"

    def apply(self, state: State, *values: cs.SX) -> State:
        return state.move_joint(self.joint, values[0] * state.reading_of_joint(self.by))

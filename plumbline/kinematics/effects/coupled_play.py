r"""A joint is dragged by another's play: :math:`q_i \leftarrow q_i - \tfrac12 b_{ij}\, s_j`.

The cables or shafts that drive an outer joint i run across the inner joints j < i, so that the
slack that joint j takes up on the side :math:`s_j` of its last approach shows in joint i, whatever
joint i itself did. A brace or a hose may drag an inner joint as well. Cables may run either way
round, so :math:`b_{ij}` has either sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.backlash import BY, side_of_approach
from plumbline.kinematics.effects.effect import Effect, JointEffect, Scope, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class CoupledPlay(JointEffect):
    """Joint ``joint`` shows the play of joint ``other``."""

    joint: int = 2
    other: int = 1
    by: str = "direction"

    name = "coupled_play"
    depends_on = "direction"
    needs_one_of = ("direction", "velocity")
    words = "joint {element} is dragged along by the play of joint {other}"
    reference = "Miyasaka et al. (2016), IEEE/RSJ IROS, doi 10.1109/IROS.2016.7759155"
    source = (
        "width: as play of the joint itself; range: wrists on cables, whose play reaches 0.3 rad "
        "(Hwang et al. 2020, IEEE RA-L 5(4))"
    )
    play = Parameter(
        "rad", -0.35, 0.35, scale=5e-4, doc="full width of what the other's play moves"
    )

    @property
    def variant(self) -> str:
        """Whose play, and what tells its side."""
        return f"of joint {self.other}{', ' * bool(BY[self.by])}{BY[self.by]}"

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every ordered pair of joints."""
        [by] = side_of_approach(scope)
        return [cls(i, j, by) for i in scope.joints for j in scope.joints if j != i]

    def apply(self, state: State, *values: cs.SX) -> State:
        side = cs.sign(state.row[self.by][self.other - 1])
        return state.move_joint(self.joint, -values[0] / 2 * side)

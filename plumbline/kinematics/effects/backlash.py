r"""Play between motor and link: :math:`q_i \leftarrow q_i - \tfrac12 b_i\, s_i`.

:math:`s_i` is the side of the last approach (1 if the joint came from below): the link lags behind
the motor by half the play. Without a recorded side the sign of the velocity serves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.effect import Effect, JointEffect, Scope, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class Backlash(JointEffect):
    """Play that depends on the side of the last approach alone."""

    velocity: bool = False

    name = "backlash"
    needs_one_of = ("direction", "velocity")
    words = "joint {element} has play: it stops short on either side of an approach"
    reference = "Nordin and Gutman (2002), Automatica 38(10), eq. 1"
    play = Parameter("rad", -2e-2, 2e-2, scale=5e-4, doc="full width of the play")

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """By the recorded side, else by the velocity's sign."""
        if not cls.fits(scope):
            return []
        velocity = not scope.has("direction")
        return [cls(joint=j + 1, velocity=velocity) for j in range(scope.chain.n)]

    def apply(self, state: State, *values: cs.SX) -> State:
        """Lag by half the play."""
        column = "velocity" if self.velocity else "direction"
        side = cs.sign(state.row[column][self.joint - 1])
        return state.move_joint(self.joint, -values[0] / 2 * side)

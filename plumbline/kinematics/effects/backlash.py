r"""Play between motor and link: :math:`q_i \leftarrow q_i - \tfrac12 b_i\, s_i`, :math:`b_i \ge 0`.

:math:`s_i` is the side of the last approach (1 if the joint came from below): the link lags behind
the motor by half the play. Without a recorded side the sign of the velocity serves. A link that
weighs more than its friction holds rests on the flank that its load chooses, from whichever side it
came: then :math:`s_i = \mathrm{sign}\, \tau_i`, with the torque :math:`\tau_i` that the drive holds
against gravity, or the measured effort. Where friction bears some of it, about a seat :math:`w_i`,
the link comes to rest in between: :math:`s_i = \tanh(\tau_i / w_i)`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs

from plumbline.kinematics.effects.effect import Effect, JointEffect, Scope, State
from plumbline.kinematics.parameters import Parameter

BY = {
    "direction": "",
    "velocity": "by the velocity's sign",
    "effort": "on the side that the measured effort chooses",
    "load": "on the side that its load chooses",
}
SEAT = 0.03  # of a joint's largest load: friction of a gear, some per cent of its rated torque


@dataclass(frozen=True)
class Backlash(JointEffect):
    """Play that depends on a side alone: of the approach, or of the load."""

    by: str = "direction"
    seat: float = field(default=0.0, metadata={"unit": "N m"})

    depends_on = "direction"
    name = "backlash"
    needs_one_of = ("direction", "velocity", "effort")
    words = "joint {element} has play: it stops short on either side of an approach"
    reference = "Nordin and Gutman (2002), Automatica 38(10), eq. 1"
    source = (
        "width: 1 to 3 arc minutes of planetary gears (makers' data); range: play is play, and "
        "wrists on cables have up to 0.3 rad of it (Hwang et al. 2020, IEEE RA-L 5(4))"
    )
    play = Parameter("rad", 0.0, 0.35, scale=5e-4, doc="full width of the play")

    @property
    def variant(self) -> str:
        """What chooses the side, where it is not the approach."""
        return f"{BY[self.by]}, over {self.seat:.2g} N m" if self.seat else BY[self.by]

    @property
    def sentence(self) -> str:
        """Which side the play is on."""
        lying = f"joint {self.joint} has play: it rests {BY[self.by]}"
        return lying if self.by in ("effort", "load") else super().sentence

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """By the recorded side, else by the velocity's sign; and by a load that changes sign."""
        found = [cls(j, by) for by in side_of_approach(scope) for j in scope.joints]
        loads = [(j, by) for by in ("effort", "load") for j in scope.joints]
        return [*found, *(cls(j, by) for j, by in loads if scope.changes_sign(by, j))]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Of a load's side: seated within a part of the load, less and more of it."""
        if self.by != "load":
            return []
        usual = SEAT * max(map(abs, scope.span[f"load{self.joint}"]))
        seats = [(self.seat or usual) * f for f in (0.3, 0.55, 1.0, 1.8, 3.0)]
        most = 3.0 * usual  # what is seated over more than friction bears is a spring
        return [replace(self, seat=s) for s in seats if s != self.seat and s <= most]

    @classmethod
    def lacks(cls, scope: Scope) -> str:
        """A column that tells a side, where no joint's weight changes sides."""
        heavy = any(scope.changes_sign("load", j) for j in scope.joints)
        return "" if heavy else super().lacks(scope)

    def apply(self, state: State, *values: cs.SX) -> State:
        column = state.nominal.load if self.by == "load" else state.row[self.by]
        load = column[self.joint - 1]
        side = cs.tanh(load / self.seat) if self.seat else cs.sign(load)
        return state.move_joint(self.joint, -values[0] / 2 * side)


def side_of_approach(scope: Scope) -> tuple[str, ...]:
    """The column that tells from which side a joint came: the recorded side, else the velocity."""
    return next(((c,) for c in ("direction", "velocity") if scope.has(c)), ())

r"""Play between motor and joint: the joint stays in :math:`[y - b, y + b]` until it is pushed.

A position loop without an integral against dry friction stops short by friction over stiffness, on
either side: without a lag the same play operator, with one the form ``inside``, whose error acts
less by b all the time, :math:`\tilde e = e - \operatorname{clip}(e, \pm b)`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.drive import Drive
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.law import Law
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ActuationPlay(MotionEffect):
    """The joint stays behind its command by up to half the play, on either side."""

    inside: bool = False  # whether it is inside of the servo's loop, in front of the lag

    name = "actuation_play"
    first = (0.004, 0.02)  # a narrow one and a wide one
    depends_on = "direction"
    words = "joint {element} has play behind its drive, or friction that stops it short"
    reference = "Nordin and Gutman (2002), Automatica 38(10), sec. 2 (backlash as a play operator)"
    source = "by hand: cables and gears of teaching arms, a degree; the bound is a worn gear"
    # Harmonic drives have 0.3 mrad; spur gears of hobby servos with friction up to 50 mrad.
    half_play = Parameter("rad", 0.0, 0.2, scale=0.01, doc="half the play's full width")

    @property
    def variant(self) -> str:
        """Where the play is."""
        return "inside of the servo's loop" if self.inside else ""

    def apply(self, drive: Drive, value: cs.SX) -> Drive:
        return drive.changed(stick=value) if self.inside else drive.changed(slack=value)

    @classmethod
    def candidates(cls, law: Law, *, masses: bool) -> Sequence[MotionEffect]:
        """Both forms where the drive has a loop of its own."""
        return [cls(), cls(inside=True)] if law.follows else [cls()]

r"""Errors that move nothing: :math:`e = \operatorname{zone}_w(c - y)`.

Nothing acts within the band, the whole error from twice its width on, a straight line between: a
joint comes to rest at the band's edge, and one that follows without a lag is always there. In the
form ``less`` what exceeds the band acts alone, :math:`e - \operatorname{clip}(e, \pm w)`. Of
commands of velocity or torque small ones are ignored, with c in place of e.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.drive import Drive, Law
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ActuationDeadband(MotionEffect):
    """A servo that takes small errors, or small velocities or torques, for none."""

    less: bool = False  # whether commands beyond the band are less by it

    name = "actuation_deadband"
    first = (0.005, 0.03)  # a narrow one and a wide one
    depends_on = "command"
    words = "the drive of joint {element} ignores small commands"
    reference = "Tao and Kokotovic (1996), Adaptive Control of Systems with Actuator ..., ch. 2"
    source = "by hand: thresholds of drives and joysticks, below a degree"
    of_command = True
    # Dead bands of serial-bus servos are set in ticks of 1.5 mrad, 1 to 30 of them.
    band = Parameter("rad", 0.0, 0.2, scale=0.01, doc="error that moves nothing, either way")

    def apply(self, drive: Drive, value: cs.SX) -> Drive:
        return drive.changed(stick=value) if self.less else drive.changed(band=value)

    @property
    def variant(self) -> str:
        """Whether large commands lose as much."""
        return "larger commands lose as much" if self.less else ""

    @classmethod
    def candidates(cls, law: Law, *, masses: bool) -> Sequence[MotionEffect]:
        """Both forms; of a servo on position the second is a play inside of its loop as well."""
        return [cls(), cls(less=True)]

r"""Errors that move nothing: :math:`e = \operatorname{zone}_w(c - y)`.

Nothing acts within the band, the whole error from twice its width on, a straight line between: a
joint comes to rest at the band's edge, and one that follows without a lag is always there. In the
form ``less`` what exceeds the band acts alone, :math:`e - \operatorname{clip}(e, \pm w)`. Of
commands of velocity or torque small ones are ignored, with c in place of e. Dry friction
takes as much of a velocity against the motion, not against the command, in the form ``rubs``: what
lags turns sooner by :math:`T \dot v = c - v - w \operatorname{sign} v`; without a lag it is
``less``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.drive import Drive
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.law import Law
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ActuationDeadband(MotionEffect):
    """A servo that takes small errors, or small velocities or torques, for none."""

    less: bool = False  # whether commands beyond the band are less by it
    rubs: bool = False  # whether that is so against the motion

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
        if not self.less:
            return drive.changed(band=value)
        return replace(drive.changed(stick=value), rubs=self.rubs)

    @property
    def variant(self) -> str:
        """Whether large commands lose as much."""
        against = ", against the motion" if self.rubs else ""
        return f"larger commands lose as much{against}" if self.less else ""

    @classmethod
    def candidates(cls, law: Law, *, masses: bool) -> Sequence[MotionEffect]:
        """Both forms; of a servo on position the second is a play inside of its loop as well.

        Of velocities the third.
        """
        rates = law in (Law.VELOCITY, Law.RATE)
        return [cls(), cls(less=True), *([cls(less=True, rubs=True)] if rates else [])]

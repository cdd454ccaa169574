r"""A command that is scaled: :math:`c = (1 + g)\,u`."""

from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.drive import Drive
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ActuationGain(MotionEffect):
    """The drive does more or less than it is asked for, in proportion."""

    name = "actuation_gain"
    depends_on = "command"
    words = "the drive of joint {element} scales its command"
    reference = "Armstrong, Khatib, Burdick (1986), ICRA, sec. 4 (drive gains of a PUMA 560)"
    source = (
        "by hand: gains are set to a tenth; the bounds are a joint that hardly moves and one that "
        "doubles"
    )
    # Motor constants differ by 10 % within a batch; a wrong gear ratio or unit by far more.
    gain = Parameter("1", -0.9, 1.0, scale=0.1, doc="share by which commands are exceeded")

    def apply(self, drive: Drive, value: cs.SX) -> Drive:
        return drive.changed(command=value * drive.command)

r"""A command that is shifted: :math:`c = u + o`."""

from dataclasses import dataclass

from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ActuationOffset(MotionEffect):
    """The zero of commands is not that of measured positions (or velocities, or torques)."""

    name = "actuation_offset"
    term = "command"
    depends_on = "nothing"
    words = "the drive of joint {element} has its zero elsewhere than its encoder"
    reference = "Mooring, Roth, Driels (1991), Fundamentals of Manipulator Calibration, sec. 2.3"
    source = "by hand: commands about another zero, a few degrees"
    of_command = True
    # Hobby servos are put on their splines by hand: one tooth of 25 is 250 mrad.
    offset = Parameter("rad", -0.5, 0.5, scale=0.05, doc="what is added to every command")

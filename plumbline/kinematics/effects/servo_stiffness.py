r"""A servo that yields to its load: :math:`q = y - k\,h`, k in rad/(N m).

So yields what is soft behind the servo. A position loop without an integral carries its load by an
error, and is as late with that as with its command: in the form ``inside`` a load sets the command
off, :math:`c \leftarrow c - k\,h`, and a joint that sticks does not yield.

Where the gains are given, the stiffness is theirs and this in series:
:math:`1 / k_p \leftarrow 1 / k_p + k`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.drive import Drive
from plumbline.kinematics.effects.motion_effect import FOLLOWING, MotionEffect
from plumbline.kinematics.law import Law
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ServoStiffness(MotionEffect):
    """Droop under the load that gravity makes: a position loop without an integral."""

    inside: bool = False  # whether what lags yields late, too

    name = "servo_stiffness"
    depends_on = "load"
    words = "the servo of joint {element} yields to the load that it carries"
    reference = (
        "Siciliano et al. (2009), Robotics, sec. 8.5.1 (PD control without gravity's torque)"
    )
    source = "by hand: droop of a position loop without integral action"
    laws = FOLLOWING
    needs_masses = True
    # Hobby servos hold 10 to 50 N m/rad, industrial drives above 1e4.
    compliance = Parameter("rad/(N m)", 0.0, 1.0, scale=0.02, doc="droop over load")

    @property
    def variant(self) -> str:
        """Where it yields."""
        return "inside of the servo's loop" if self.inside else ""

    def apply(self, drive: Drive, value: cs.SX) -> Drive:
        return drive.changed(sag=value) if self.inside else drive.changed(compliance=value)

    @classmethod
    def candidates(cls, law: Law, *, masses: bool) -> Sequence[MotionEffect]:
        """Both forms where the drive's loop is not known."""
        if law not in cls.laws or not masses:
            return []
        return [cls(), cls(inside=True)] if law.ideal else [cls()]

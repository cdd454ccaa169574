r"""A servo that yields to its load: :math:`q = y - k\,h`, k in rad/(N m).

Where the gains are given, the stiffness is theirs and this in series:
:math:`1 / k_p \leftarrow 1 / k_p + k`.
"""

from dataclasses import dataclass

from plumbline.kinematics.effects.motion_effect import FOLLOWING, MotionEffect
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ServoStiffness(MotionEffect):
    """Droop under the load that gravity makes: a position loop without an integral."""

    name = "servo_stiffness"
    term = "compliance"
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

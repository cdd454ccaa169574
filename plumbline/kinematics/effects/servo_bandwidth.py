r"""A servo of second order: :math:`s^2 \ddot y + 2 s\,\dot y = c - y`.

It is slow to set off, as one of first order is not. Its natural period is :math:`2 \pi s`, and it
is damped so that it does not overshoot, as loops on position are; a lag filters its command.
"""

import math
from dataclasses import dataclass

from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.law import Law
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ServoBandwidth(MotionEffect):
    """A position loop that moves an inertia: its bandwidth, by the period of its own motion."""

    name = "servo_bandwidth"
    term = "period"
    first = (0.2,)  # one of 5 Hz: both faster and slower ones are found from there
    depends_on = "time"
    words = "the servo of joint {element} is slow to set off"
    reference = "Siciliano et al. (2009), Robotics, sec. 8.3.1 (natural frequency, damping ratio)"
    source = "by hand: position loops of servos and elastic drives close at 1 to 20 Hz"
    laws = tuple(law for law in Law if law.ideal)
    lags = 1 / math.pi  # 2 s
    period = Parameter("s", 0.0, 2.0, scale=0.2, doc="natural period")

r"""A drive that follows slowly: :math:`T \dot y = c - y`.

Where what follows has a law of its own (a rate, a torque, known gains, a servo of second order), it
is the command that is filtered, before all of that.
"""

from dataclasses import dataclass

from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ActuationLag(MotionEffect):
    """A lag of first order between the command and what the drive does."""

    name = "actuation_lag"
    term = "lag"
    first = (0.01, 0.06)  # a fast one and a slow one
    depends_on = "time"
    lags = 1.0
    words = "joint {element} follows its commands with a lag"
    reference = "Siciliano et al. (2009), Robotics, sec. 8.3 (position loop of first order)"
    source = "by hand: loops of position close at 2 to 30 Hz"
    # 2 ms for current loops, 20 to 100 ms for hobby servos on position (Hwangbo et al. 2019).
    lag = Parameter("s", 0.0, 0.5, scale=0.03, doc="time constant")

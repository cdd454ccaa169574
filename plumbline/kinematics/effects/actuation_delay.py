r"""Commands that are obeyed late: :math:`c(t) = u(t - d)`, d of any size between samples.

A log whose rows state what acted since the row before shows joints that lead, :math:`d < 0`.
"""

from dataclasses import dataclass

from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ActuationDelay(MotionEffect):
    """Dead time of bus, driver and clock between a command and its execution."""

    name = "actuation_delay"
    term = "shift"
    first = (0.01, 0.04, 0.1)  # short and long: the misfit of a periodic motion has several valleys
    depends_on = "time"
    words = "joint {element} obeys its commands late"
    reference = "Tan et al. (2018), RSS XIV, sec. V-B (latency of a quadruped's drives)"
    source = (
        "by hand: buses and controllers answer within 1 to 100 ms; the bound is a slow wireless "
        "link"
    )
    # Field buses take 1 to 4 ms, serial chains of hobby servos and ROS 2 stacks up to 100 ms.
    # Less than none: a row of a log at 50 a second, written after its command was sent.
    delay = Parameter("s", -0.02, 0.25, scale=0.03, doc="from command to execution")

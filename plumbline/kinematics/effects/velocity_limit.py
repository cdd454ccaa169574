r"""A largest speed: :math:`|\dot y| \le \dot y_{max}`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.kinematics.effects.motion_effect import MotionEffect, Seen
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class VelocityLimit(MotionEffect):
    """The drive is asked for more speed than its voltage gives."""

    name = "velocity_limit"
    term = "fastest"
    depends_on = "velocity"
    words = "the drive of joint {element} reaches its largest speed"
    reference = "Craig (2005), Introduction to Robotics, sec. 9.9 (saturation of actuators)"
    source = "makers' data of joints, 1 to 10 rad/s; the null is a motor without a limit"
    # 3 to 10 rad/s at the joint; no joint of an arm reaches the null.
    fastest = Parameter("rad/s", 1e-3, 1e4, scale=5.0, null=1e4, doc="largest speed")

    def starts(self, seen: Seen) -> Sequence[float]:
        """What was hardly ever exceeded, and less: noise makes measured speeds look larger."""
        return [max(float(np.quantile(np.abs(seen.speed), k)), 2e-3) for k in (0.97, 0.8, 0.5)]

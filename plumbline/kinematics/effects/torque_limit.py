r"""A largest torque: :math:`|I \ddot y + h| \le \tau_{max}`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.kinematics.effects.motion_effect import MotionEffect, Seen
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class TorqueLimit(MotionEffect):
    """The drive is asked for more torque than its current gives."""

    name = "torque_limit"
    term = "strongest"
    depends_on = "load"
    words = "the drive of joint {element} reaches its largest torque"
    reference = "Craig (2005), Introduction to Robotics, sec. 9.9 (saturation of actuators)"
    source = "makers' data of joints, 1 to 1,000 N m; the null is a motor without a limit"
    needs_masses = True
    # 2 N m for hobby servos, 25 to 45 for quadrupeds, 330 for a UR10's shoulder.
    strongest = Parameter("N m", 1e-3, 1e6, scale=20.0, null=1e6, doc="largest torque")

    def starts(self, seen: Seen) -> Sequence[float]:
        """What was hardly ever needed, and somewhat less."""
        return [max(float(np.quantile(np.abs(seen.torque), k)), 2e-3) for k in (0.99, 0.9)]

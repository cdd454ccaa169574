r"""A largest speed: :math:`|\dot y| \le \dot y_{max}`.

Of the drive's own motion; in the form ``told`` whatever sends the commands on keeps them from
changing faster, :math:`|\dot c| \le \dot y_{max}`, and what lags is late with that.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from plumbline.kinematics.drive import Drive
from plumbline.kinematics.effects.motion_effect import MotionEffect, Seen
from plumbline.kinematics.law import Law
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class VelocityLimit(MotionEffect):
    """The drive is asked for more speed than its voltage, or who sends its commands on, gives."""

    told: bool = False  # whether it is the commands' largest, before all that the drive does

    name = "velocity_limit"
    term = "fastest"
    depends_on = "velocity"
    words = "the drive of joint {element} reaches its largest speed"
    reference = "Craig (2005), Introduction to Robotics, sec. 9.9 (saturation of actuators)"
    source = "makers' data of joints, 1 to 10 rad/s; the null is a motor without a limit"
    # 3 to 10 rad/s at the joint; no joint of an arm reaches the null.
    fastest = Parameter("rad/s", 1e-3, 1e4, scale=5.0, null=1e4, doc="largest speed")

    @property
    def variant(self) -> str:
        """Whose largest speed it is."""
        return "of what the drive is told" if self.told else ""

    def apply(self, drive: Drive, value: cs.SX) -> Drive:
        return drive.changed(paced=value) if self.told else drive.changed(fastest=value)

    @classmethod
    def candidates(cls, law: Law, *, masses: bool) -> Sequence[MotionEffect]:
        """Both forms where a drive that is told places has a loop of its own."""
        return [cls(), cls(told=True)] if law.follows else [cls()]

    def starts(self, seen: Seen) -> Sequence[float]:
        """What was hardly ever exceeded, and less: noise makes measured speeds look larger."""
        return [max(float(np.quantile(np.abs(seen.speed), k)), 2e-3) for k in (0.97, 0.8, 0.5)]

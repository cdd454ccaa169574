r"""A largest acceleration of the servo's own reference: commands are reached by ramps of speed.

A positioning servo plans its way to each command: it speeds up and brakes by at most
:math:`\ddot p_{max}`, so that it could stop where it was told,

.. math:: \dot p \to \operatorname{sign}(c - p) \sqrt{2\, \ddot p_{max}\, |c - p|}, \qquad
          |\ddot p| \le \ddot p_{max}

and obeys p in place of the command. What it is asked for at :math:`A \omega^2 > \ddot p_{max}`
comes smaller and late by up to half a period, whatever the motor could do.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.kinematics.effects.motion_effect import FOLLOWING, MotionEffect, Seen
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class AccelerationLimit(MotionEffect):
    """The servo reaches its commands by ramps of speed."""

    name = "acceleration_limit"
    term = "steepest"
    depends_on = "command"
    words = "the servo of joint {element} plans its way with a largest acceleration"
    reference = "Zanasi, Lo Bianco, Tonielli (2000), Automatica 36(4) (nonlinear filters of paths)"
    source = (
        "makers' tables of serial-bus servos, 1 to 254 units of 0.15 rad/s^2; the null plans "
        "nothing"
    )
    plans = True
    laws = FOLLOWING
    # 39 rad/s^2 is the most that hobby servos on a bus can be set to; arms plan with 1 to 20.
    steepest = Parameter("rad/s^2", 0.1, 1e16, scale=20.0, null=1e16, doc="largest acceleration")

    def starts(self, seen: Seen) -> Sequence[float]:
        """What the commands hardly ever asked for, and less."""
        asked = np.abs(seen.asked)
        return [max(float(np.quantile(asked, k)), 0.5) for k in (0.97, 0.8, 0.5)]

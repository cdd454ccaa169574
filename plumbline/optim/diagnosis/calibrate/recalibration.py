r"""Stated probabilities against how often they were right.

A statement of probability p that turned out y, right or wrong, is believed to have had the
probability q with

.. math:: \operatorname{logit} q = a \operatorname{logit} p + b

(Platt 1999; as a recalibration of probabilities Cox 1958). The fit is the most probable one under
:math:`a \sim N(1, 0.5^2)`, :math:`b \sim N(0, 1)`, so that few statements change little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np
from scipy.special import expit, logit

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.prior import OFFSET_WIDTH, SLOPE_WIDTH, SUREST


@dataclass(frozen=True)
class Recalibration:
    """The line in log odds; the identity unless fitted.

    Attributes:
        slope: The a of the formula; below 1 where statements were too sure.
        offset: The b; below 0 where too much was named.
    """

    slope: float = 1.0
    offset: float = 0.0

    @classmethod
    def of(cls, stated: Sequence[float], right: Sequence[bool]) -> Recalibration:
        """The most probable line of some statements."""
        if not len(stated):
            return cls()
        line, z = cs.MX.sym("line", 2), cs.MX(_log_odds(stated))
        t = cs.DM(np.where(right, -1.0, 1.0)) * (line[0] * z + line[1])
        surprise = cs.sum1(cs.fmax(t, 0.0) + cs.log1p(cs.exp(-cs.fabs(t))))
        prior = ((line[0] - 1.0) / SLOPE_WIDTH) ** 2 + (line[1] / OFFSET_WIDTH) ** 2
        statement: Any = {"x": line, "f": surprise + 0.5 * prior}
        quiet: Any = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
        found = cs.nlpsol("line", "ipopt", statement, quiet)(x0=[1.0, 0.0])["x"]
        return cls(*np.asarray(found, dtype=float).ravel().tolist())

    def __call__(self, stated: float) -> float:
        """What a stated probability is worth."""
        if self == Recalibration():
            return stated
        return float(expit(self.slope * _log_odds([stated])[0] + self.offset))


def _log_odds(stated: Sequence[float]) -> Array:
    return np.asarray(logit(np.clip(np.asarray(stated, dtype=float), SUREST, 1.0 - SUREST)))

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

import numpy as np
from scipy.optimize import root
from scipy.special import expit, logit

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import FLAT
from plumbline.optim.diagnosis.prior import OFFSET_WIDTH, SLOPE_WIDTH, SUREST

IDENTITY = np.array([1.0, 0.0])  # slope and offset of a line that changes nothing


@dataclass(frozen=True)
class Recalibration:
    """The line in log odds; the identity unless fitted."""

    slope: float = 1.0  # the a of the formula; below 1 where statements were too sure
    offset: float = 0.0  # the b; below 0 where too much was named

    @classmethod
    def of(cls, stated: Sequence[float], right: Sequence[bool]) -> Recalibration:
        """The most probable line of some statements."""
        if not len(stated):
            return cls()
        X = np.column_stack([_log_odds(stated), np.ones(len(stated))])
        signs = np.where(right, 1.0, -1.0)
        widths = np.array([SLOPE_WIDTH, OFFSET_WIDTH])

        def slope(line: Array) -> Array:
            misses = signs * expit(-signs * (X @ line))
            return np.asarray((line - IDENTITY) / widths**2 - misses @ X)

        def curvature(line: Array) -> Array:
            odds = X @ line
            return np.asarray(np.diag(widths**-2.0) + (X.T * (expit(odds) * expit(-odds))) @ X)

        # The cost is convex, with a curvature of at least 1: where its slope vanishes it is least.
        return cls(*root(slope, IDENTITY, jac=curvature, tol=FLAT).x.tolist())

    def __call__(self, stated: float) -> float:
        """What a stated probability is worth."""
        if self == Recalibration():
            return stated
        return float(expit(self.slope * _log_odds([stated])[0] + self.offset))


def _log_odds(stated: Sequence[float]) -> Array:
    return np.asarray(logit(np.clip(np.asarray(stated, dtype=float), SUREST, 1.0 - SUREST)))

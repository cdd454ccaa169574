r"""Shares and medians with 95 % intervals.

A share of k in n has Wilson's (1927) interval, the p for which the score test does not reject:

.. math:: |k/n - p| \le z \sqrt{p (1 - p) / n}, \qquad z = 1.96.

A median has the interval between the k-th value from below and the k-th from above, for the largest
k with

.. math:: 1 - 2 P(B < k) \ge 0.95, \qquad B \sim \text{Binomial}(n, 1/2),

whatever the values are drawn from. Even the least and the greatest of five hold it with 94 % only,
so that below six values there is a median and no interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from plumbline.optim.core.constants import LEVEL


@dataclass(frozen=True)
class Share:
    """How many of how many; ``None`` for what there was nothing to count of."""

    count: int  # how many
    of: int  # of how many
    value: float | None  # their ratio
    low: float | None  # lower end of its interval
    high: float | None  # upper end

    def __str__(self) -> str:
        """``38 of 45 (71 % to 92 %)``."""
        if self.low is None or self.high is None:
            return "none of none"
        return f"{self.count} of {self.of} ({100 * self.low:.0f} % to {100 * self.high:.0f} %)"

    @classmethod
    def count_of(cls, count: int, of: int) -> Share:
        """The share with its interval."""
        if not of:
            return cls(0, 0, None, None, None)
        interval = scipy.stats.binomtest(count, of).proportion_ci(LEVEL, method="wilson")
        return cls(count, of, count / of, float(interval.low), float(interval.high))


@dataclass(frozen=True)
class Median:
    """A median of so many values with its interval."""

    of: int  # of how many values
    value: float | None  # the median; none if there are no values
    low: float | None  # lower end of its interval; none where the values are too few for one
    high: float | None  # upper end, likewise

    @classmethod
    def of_values(cls, values: Sequence[float]) -> Median:
        """The median and the order statistics around it."""
        ordered, n = np.sort(np.asarray(values, dtype=float)), len(values)
        if not n:
            return cls(0, None, None, None)
        value, k = float(np.median(ordered)), int(scipy.stats.binom.ppf((1 - LEVEL) / 2, n, 0.5))
        if not k:
            return cls(n, value, None, None)
        return cls(n, value, float(ordered[k - 1]), float(ordered[n - k]))

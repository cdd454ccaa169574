r"""Numbers in words: units a reader knows, as many digits as the number bears.

A value is shown to two digits of its standard error: 0.24031 mm ± 0.0061 mm is 0.2403 ± 0.0061 mm.

Shares and medians with 95 % intervals.

A share of k in n has Wilson's (1927) interval, the p for which the score test does not reject:

.. math:: |k/n - p| \le z \sqrt{p (1 - p) / n}, \qquad z = 1.96.

A median has the interval between the k-th value from below and the k-th from above, for the largest
k with

.. math:: 1 - 2 P(B < k) \ge 0.95, \qquad B \sim \text{Binomial}(n, 1/2),

whatever the values are drawn from. Even the least and the greatest of five hold it with 94 % only,
so that below six values there is a median and no interval.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from plumbline.optim.core.constants import BARELY, LEVEL, SURE

# Factor and name of the unit that is shown for an SI unit.
SHOWN = {
    "m": (1e3, "mm"),
    "rad": (1e3, "mrad"),
    "s": (1e3, "ms"),
    "1": (1e3, "‰"),
    "1/K": (1e6, "ppm/K"),
    "s/K": (1e6, "ppm s/K"),
    "rad/(N m)": (1e6, "µrad/(N m)"),
    "rad kg/(N m)": (1e6, "µrad kg/(N m)"),
    "rad/(N m)^2": (1e9, "nrad/(N m)²"),
    "kg m^2": (1.0, "kg m²"),
    "m/N": (1e6, "µm/N"),
    "m kg/N": (1e6, "µm kg/N"),
    "m/N^2": (1e9, "nm/N²"),
    "1/(N m^2)": (1e6, "×10⁻⁶/(N m²)"),
}
# A hobby servo yields a thousand times as far as an industrial arm: what is shown instead from a
# thousand on.
COARSER = {
    "µrad/(N m)": (1e3, "mrad/(N m)"),
    "µrad kg/(N m)": (1e3, "mrad kg/(N m)"),
    "µm/N": (1e3, "mm/N"),
    "µm kg/N": (1e3, "mm kg/N"),
}


def scaled(unit: str, value: float = 0.0) -> tuple[float, str]:
    """Factor to the unit that a value is shown in, and its name; one not known here stays."""
    factor, name = SHOWN.get(unit, (1.0, unit))
    return COARSER[name] if name in COARSER and abs(value) * factor >= 1e3 else (factor, name)


def quantity(value: float, unit: str) -> str:
    """``0.824 mm``: a value [unit] to three significant digits."""
    factor, name = scaled(unit, value)
    return f"{significant(value * factor)} {name}".rstrip()


def significant(value: float, digits: int = 3) -> str:
    """``0.0870``: so many significant digits, zeros kept; powers of ten where they read better."""
    if not math.isfinite(value):
        return "unknown"
    if value == 0.0:
        return "0"
    power = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -4 <= power <= 5:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - power, 0)}f}"


def measured(value: float, std: float, unit: str) -> str:
    """``0.2403 ± 0.0061 mm``: a value and its standard error [unit]."""
    factor, name = scaled(unit, value)
    value, std = value * factor, std * factor
    if not (math.isfinite(value) and math.isfinite(std) and std > 0.0):
        return f"{significant(value)} {name}".rstrip()
    places = 1 - math.floor(math.log10(std))
    if not 0 <= places <= 6 or abs(value) >= 1e6:
        return f"{significant(value)} ± {significant(std, 2)} {name}".rstrip()
    value = round(value, places) + 0.0  # no minus before a zero
    return f"{value:.{places}f} ± {std:.{places}f} {name}".rstrip()


def percent(share: float) -> str:
    """``98 %``; what is not quite certain never reads 0 or 100."""
    if not math.isfinite(share):
        return "unknown"
    if 1.0 - BARELY <= share < 1.0:
        return "> 99 %"
    if 0.0 < share < BARELY:
        return "< 1 %"
    return f"{100.0 * share:.0f} %"


def chance(probability: float) -> str:
    """``98 %`` of a probability, which the arithmetic may round to 0 or 1 but no data make so."""
    return percent(min(max(probability, SURE), 1.0 - SURE))


def counted(count: int, noun: str) -> str:
    """``1 cause``, ``3 causes``."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def enumerated(words: Sequence[str]) -> str:
    """``1, 2 and 3``."""
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


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
    def count_of(cls, count: int, of: int) -> Self:
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
    def of_values(cls, values: Sequence[float]) -> Self:
        """The median and the order statistics around it."""
        ordered, n = np.sort(np.asarray(values, dtype=float)), len(values)
        if not n:
            return cls(0, None, None, None)
        value, k = float(np.median(ordered)), int(scipy.stats.binom.ppf((1 - LEVEL) / 2, n, 0.5))
        if not k:
            return cls(n, value, None, None)
        return cls(n, value, float(ordered[k - 1]), float(ordered[n - k]))

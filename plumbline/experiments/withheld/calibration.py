r"""Can the probabilities be believed?

Statements of probability p are sorted into ten bins of equal width; with n_b statements in a bin,
mean probability p_b and share of right ones a_b, the expected calibration error (Naeini, Cooper and
Hauskrecht, 2015) is

.. math:: ECE = \sum_b \frac{n_b}{n} |a_b - p_b|.

Statements of one case are not independent, so its interval is a bootstrap over cases. Of few
statements it is large though each is right as often as it says: so large as that is expected.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import Share

BINS = 10  # of equal width, as Naeini et al. have them
REPEATS = 1000  # of the bootstrap: ends of an interval are known to a fiftieth of its width
Said = Sequence[tuple[float, bool]]  # probability, right


@dataclass(frozen=True)
class Bin:
    """Statements of about the same probability: what they said, and how many were right."""

    low: float
    high: float
    stated: float
    right: Share


@dataclass(frozen=True)
class Calibration:
    """The reliability curve and its error."""

    statements: int  # number of statements
    ece: float | None  # expected calibration error; None without statements
    low: float | None  # lower end of its 95 % interval
    high: float | None  # upper end
    curve: tuple[Bin, ...]  # bins that hold statements
    chance: float | None = None  # error that is expected where every probability is right


def calibration(cases: Sequence[Said], seed: int = 0) -> Calibration:
    """Reliability of statements, listed case by case."""
    sums = np.zeros((len(cases), BINS, 3))
    for k, said in enumerate(cases):
        for probability, right in said:
            b = min(int(probability * BINS), BINS - 1)
            sums[k, b] += (1.0, probability, float(right))
    total = sums.sum(axis=0)
    count = int(total[:, 0].sum())
    if not count:
        return Calibration(0, None, None, None, ())
    rng = np.random.default_rng(seed)
    weights = rng.multinomial(len(cases), np.full(len(cases), 1 / len(cases)), REPEATS)
    drawn = _error(np.tensordot(weights, sums, axes=1))
    low, high = np.nanquantile(drawn, [0.025, 0.975])
    curve = tuple(
        Bin(b / BINS, (b + 1) / BINS, float(said / n), Share.count_of(int(right), int(n)))
        for b, (n, said, right) in enumerate(total)
        if n
    )
    stated = np.array([probability for said in cases for probability, _ in said])
    chance = _chance(total, stated, rng)
    return Calibration(count, float(_error(total)), float(low), float(high), curve, chance)


def _chance(total: Array, stated: Array, rng: np.random.Generator) -> float:
    """Mean error of as many statements (n,), each as often right as it says."""
    own = np.eye(BINS)[np.minimum((stated * BINS).astype(int), BINS - 1)]
    drawn = np.tile(total, (REPEATS, 1, 1))
    drawn[..., 2] = (rng.random((REPEATS, len(stated))) < stated) @ own
    return float(_error(drawn).mean())


def _error(sums: Array) -> Array:
    """Expected calibration errors (...) from each bin's count, probabilities, right (..., B, 3)."""
    count = sums[..., 0].sum(axis=-1)
    apart = np.abs(sums[..., 2] - sums[..., 1]).sum(axis=-1)
    return np.where(count > 0, apart / np.maximum(count, 1), np.nan)

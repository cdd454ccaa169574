r"""Whether rows know of each other, or err with their speed: by evidence, of what a state leaves.

What is left of m components a row is Gaussian with correlation :math:`\rho^d` between rows d apart,
or c between readings of one posture, or wider along a row's motion by what its clock is uncertain
of, or along what its joints move by what these scatter, see
:mod:`plumbline.optim.measurement.uneven`. With R its correlation matrix and the noise's size
integrated out, of which a statement says nothing here: where it is too large, rows would seem
alike,

.. math:: \log p = -\tfrac12 \log\det R - \tfrac n2 \log \mathrm{tr}\, e^T R^{-1} e

is tried over a grid, and a correlation is taken only where the data ask for it (Schwarz 1978). What
a fit left it left of white noise: of noise that wanders, or is shared, another one would be the
best, and of slow noise its columns A, with priors :math:`\Lambda`, take up more. So where these are
known all their values are integrated out, flat ones too (Harville 1977, J. Am. Stat. Assoc. 72,
eq. 3.7):

.. math:: \log p = -\tfrac12 \log\det R - \tfrac12 \log\det (A^T R^{-1} A + \Lambda)
          - \tfrac{n - p}2 \log |t - A \hat z|^2_{R^{-1}}

As the state may hold slow functions of time and whatever else the library lacks, all that these
explain may be theirs.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from plumbline.optim.core.mapped import back_to_rows, less_foretold
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import JITTER
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.prior import (
    CORRELATIONS,
    JITTERS,
    LEAST_SPREAD,
    LEAST_SWING,
    NOISE_NEGLIGIBLE,
)
from plumbline.optim.measurement.correlated import follows_of, postures
from plumbline.optim.measurement.uneven import along, powers
from plumbline.optim.recording.recording import Recording


class RowNoise(NamedTuple):
    """How the noise of a recording's rows is not one and the same, see there."""

    wander: float = 0.0
    alike: float = 0.0
    jitter: float = 0.0
    scatter: tuple[float, ...] = ()  # of each joint; empty if none does


class Left(NamedTuple):
    """What a fit leaves of rows, and what it may take up of them."""

    rows: Array  # what it leaves (N, m)
    columns: Array  # of what is fitted (P, N, m)
    precision: Array  # of the priors of its values (P,), over that of a row's noise; 0 of flat ones
    values: Array  # where it ended (P,); of flat ones anywhere

    def of(self, rows: NDArray[np.bool_]) -> Self:
        """The same of some rows (N,)."""
        return self._replace(rows=self.rows[rows], columns=self.columns[:, rows])


def left_by_nothing(rows: Array) -> Left:
    """Of rows (N, m) that nothing is fitted to."""
    return Left(rows, np.zeros((0, *rows.shape)), np.zeros(0), np.zeros(0))


def correlation_of(
    left: Array,
    recording: Recording,
    noise: NoisePrior,
    v: Array | None = None,
    moved: Array | None = None,
    *,
    in_order: bool = True,
    spread: Array | float = 1.0,
    fitted: Left | None = None,
) -> tuple[RowNoise, float]:
    """What is asked for, and its log odds against the recording's own.

    Args:
        left: What a state leaves (N, m), as measured.
        recording: These rows.
        noise: The prior of the noise.
        v: How fast the rows move (N, m), where it may be their clock that errs.
        moved: What a unit of each joint moves of them (n, N, m), where these may scatter.
        in_order: Whether rows may wander, or be alike, with what comes before them.
        spread: In units of which noise of each component (m,) what is left is. Joints that scatter
            are instead of that.
        fitted: The same rows with what the state takes up of them; as if nothing, if not given.
    """
    now = RowNoise(recording.wander, recording.alike, recording.jitter)
    price = 0.5 * np.log(max(left.size, 2))
    tried = {RowNoise(): 0.0}
    if in_order:
        found = _in_order(fitted or left_by_nothing(left), recording, noise)
        tried |= {told: gain - price for told, gain in found}
    v = np.zeros_like(left) if v is None else v
    white = _wandering(left_by_nothing(left), recording, noise, 0.0)
    for ratio in JITTERS if v.any() else ():
        size = ratio / float(np.sqrt(np.mean(v**2)))
        likely = _wide(left, size * v[None], noise.least)
        tried[RowNoise(jitter=size)] = likely - white - price
    near = min(tried, key=lambda found: float(np.abs(np.subtract(found[:3], now[:3])).sum()))
    own = left * spread
    square = np.mean(own**2, axis=0)
    # Where an axis has no noise, as in a plane, joints would seem to scatter.
    if moved is not None and square.min() > LEAST_SPREAD * square.mean():
        handicap = _log_odds_of(spread, len(left))
        # A device's noise is no less than it is stated, nor all but nought.
        least = noise.sigma or float(np.sqrt(LEAST_SPREAD * square.mean()))
        least = max(least, noise.least)
        scatters = list(_scatters(own, moved, least))
        if recording.scatter is not None:
            near = RowNoise(scatter=tuple(recording.scatter.tolist()))
            scatters.append(recording.scatter)
        for k in scatters:
            likely = _priced(own, moved, least, k) - handicap
            tried[RowNoise(scatter=tuple(k.tolist()))] = likely - white
    # It must do far better than none; against what else explains the rows it counts as it is.
    best = max(tried, key=lambda told: tried[told] - NOISE_NEGLIGIBLE * (told != RowNoise()))
    return best, tried[best] - tried[near]


def _log_odds_of(spread: Array | float, rows: int) -> float:
    """Log odds of noise that differs from component to component so, by what N rows leave."""
    if np.all(spread == 1.0):
        return 0.0
    price = 0.5 * (np.size(spread) - 1) * np.log(max(rows, 2)) + NOISE_NEGLIGIBLE
    return float(-rows * np.log(spread).sum() - price)


def _scatters(left: Array, moved: Array, least: float) -> Iterator[Array]:
    """What joints scatter by (n,), over the noise: all alike, each as it likes, fewer and fewer.

    The size of the noise is worked out, as above, and has a least one.
    """
    usual = np.sqrt(np.mean(np.sum(moved**2, axis=2), axis=1))
    seen = usual > LEAST_SWING * usual.max(initial=0.0)
    unit = np.divide(1.0, usual, out=np.zeros(len(moved)), where=seen)

    def best(ways: Array) -> Array:
        """Of joints that scatter together (K, n) in one measure, relative to each other."""

        def cost(shares: Array) -> tuple[float, Array]:
            k = np.sqrt(shares @ ways**2)
            inverse = np.linalg.inv(along(k[:, None, None] * moved))
            gone = (inverse @ left[..., None])[..., 0]
            square, floor = (
                float(np.sum(gone * left)),
                least**2 * float(np.einsum("naa->", inverse)),
            )
            seen = (inverse @ moved[..., None])[..., 0]
            own = np.sum(seen * moved, axis=(1, 2))
            told = np.sum(np.einsum("kna,na->kn", moved, gone) ** 2, axis=1)
            if floor > square:
                square, told = floor, least**2 * np.sum(seen**2, axis=(1, 2))
            slope = 0.5 * (ways**2 @ (own - left.size * told / square))
            log_det = -float(np.linalg.slogdet(inverse)[1].sum())
            return 0.5 * (log_det + left.size * float(np.log(square))), slope

        start, bounds = np.full(len(ways), 1.0 / len(ways)), [(0.0, None)] * len(ways)
        done = scipy.optimize.minimize(cost, start, jac=True, bounds=bounds, method="L-BFGS-B")
        return np.asarray(np.sqrt(done.x @ ways**2))

    some = np.flatnonzero(unit)
    yield best(np.full((1, len(moved)), unit.max(initial=0.0)))
    while len(some):
        k = best(np.diag(unit)[some])
        yield k
        some = some[np.argsort(k[some] / unit[some])[1:]]


def _priced(left: Array, moved: Array, least: float, k: Array) -> float:
    """Log likelihood of what joints scatter by (n,), less the price of as many numbers.

    Which joints was chosen, of one number that all have nothing.
    """
    numbers = len(np.unique(k[k > 0.0]))
    ways = 0.0 if k.all() and numbers == 1 else numbers * float(np.log(len(k)))
    price = 0.5 * numbers * float(np.log(max(left.size, 2))) + ways
    return _wide(left, k[:, None, None] * moved, least) - price


def _log_likelihood(
    square: float, log_det: float, trace: float, left: Array, least: float
) -> float:
    """Of what is left, from its whitened square, and R of all of it: its determinant, tr R^-1.

    What rounding leaves, or the finest device, is white.
    """
    known = max(square, trace * least**2)
    return -0.5 * (log_det + left.size * float(np.log(known)))


def _wide(left: Array, moved: Array, least: float) -> float:
    """Of noise that is wider along some ways (K, N, m)."""
    inverse = powers(along(moved), -1.0)
    square = float(np.einsum("na,nab,nb->", left, inverse, left))
    log_det = -float(np.linalg.slogdet(inverse)[1].sum())
    trace = float(np.einsum("naa->", inverse))
    return _log_likelihood(square, log_det, trace, left, least)


def _in_order(
    left: Left, recording: Recording, noise: NoisePrior
) -> Iterator[tuple[RowNoise, float]]:
    """Noise that wanders, or is shared by readings of a posture, and its gain over white noise."""
    posture = postures(recording)
    white = _wandering(left, recording, noise, 0.0)
    again = not np.array_equal(posture, np.arange(len(left.rows)))
    for r in CORRELATIONS:
        yield RowNoise(wander=r), _wandering(left, recording, noise, r) - white
        if again:
            yield RowNoise(alike=r), _alike(left, posture, noise, r) - white


@dataclass(frozen=True)
class _Root:
    """A root of R's inverse, for rows (N, k), and its transpose."""

    white: Callable[[Array], Array]
    back: Callable[[Array], Array]
    log_det: float  # of R
    trace: float  # of its inverse

    def likely(self, left: Left, least: float) -> float:
        """Log of how likely a fit's rows are, all its values integrated out."""
        (N, m), flat = left.rows.shape, int(np.sum(left.precision == 0.0))
        e, prior = self.white(left.rows).ravel(), left.precision * left.values
        columns = np.moveaxis(left.columns, 0, 2).reshape(N, -1)
        seen = self.white(columns)
        A = seen.reshape(N * m, len(left.columns))
        # Rows that a flat one is of may be missing: then it is nobody's.
        H, g = A.T @ A + np.diag(left.precision + JITTER), A.T @ e - prior
        # What the priors cost is in units of another noise than the one that is left.
        square = float(np.sum((e - A @ np.linalg.solve(H, g)) ** 2))
        floor = m * self.trace
        if square < floor * least**2:  # what rounding leaves, or the finest device, is white
            B = self.back(seen).reshape(A.shape)
            floor -= float(np.trace(np.linalg.solve(H, B.T @ B)))
        known = max(square, floor * least**2)
        log_det = m * self.log_det + float(np.linalg.slogdet(H)[1])
        return -0.5 * (log_det + (N * m - flat) * float(np.log(known)))


def _wandering(left: Left, recording: Recording, noise: NoisePrior, rho: float) -> float:
    follows = follows_of(recording, rho=rho)

    def white(rows: Array) -> Array:
        return less_foretold(rows, np.zeros_like(rows[:1]), follows) if follows.size else rows

    log_det = float(np.log1p(-(follows**2)).sum())
    trace = len(left.rows) + 2.0 * float(np.sum(follows**2 / (1.0 - follows**2)))
    root = _Root(white, partial(back_to_rows, follows=follows), log_det, trace)
    return root.likely(left, noise.least)


def _alike(left: Left, posture: NDArray[np.intp], noise: NoisePrior, c: float) -> float:
    count = np.bincount(posture)
    own = 1.0 + (count - 1.0) * c
    each = (1.0 / np.sqrt(own) - 1.0 / np.sqrt(1.0 - c)) / count

    def white(rows: Array) -> Array:
        sums = np.zeros((len(count), rows.shape[1]))
        np.add.at(sums, posture, rows)
        return np.asarray(rows / np.sqrt(1.0 - c) + (each[:, None] * sums)[posture])

    log_det = float(np.sum((count - 1.0) * np.log1p(-c) + np.log(own)))
    trace = float(np.sum((count - 1.0) / (1.0 - c) + 1.0 / own))
    return _Root(white, white, log_det, trace).likely(left, noise.least)

r"""Evidence for one more effect, nuisances and noise integrated out.

With prior :math:`z \sim N(0, s^2)` in units of the effect's physical scale, an inverse-gamma prior
of :math:`\nu_0` degrees of freedom on the noise, and the eigenvalues :math:`\lambda_j` of the
candidate's projected Gram matrix (Gelman et al. 2013, Bayesian Data Analysis, sec. 14.8)

.. math:: \log B = -\tfrac12 \sum_j \log(1 + s^2 \lambda_j / \sigma^2)
          - \tfrac{\nu_0 + n}{2} \log \frac{\nu_0 \sigma_0^2 + Q}{\nu_0 \sigma_0^2 + t^T t},
          \qquad Q = t^T t - \sum_j \frac{s^2 \beta_j^2}{\sigma^2 + s^2 \lambda_j}

The scale s is summed over a logarithmic grid. Of a prior that physics bounds counts what is within:
with the posterior's mean m and deviation d of a parameter between l and u, the evidence grows by

.. math:: \log \frac{\Phi((u - m) / d) - \Phi((l - m) / d)}{\Phi(u / s) - \Phi(l / s)},

log 2 of what is on the right side of a null that is a bound, and next to none is left of what only
a value far beyond a bound would explain.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtri

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear

ALL = -float(ndtri(np.finfo(float).eps))  # standard deviations within which, to rounding, all is


@dataclass(frozen=True)
class NoisePrior:
    """What is known of the noise before the fit."""

    sigma: float = 0.0  # one standard deviation of one equation; 0 if nothing is known
    freedom: float = 0.0  # how many equations that knowledge is worth

    @classmethod
    def of(cls, noise_std: float | None) -> Self:
        """A stated noise is believed as one of so many readings is."""
        return cls(noise_std, prior.KNOWN_NOISE_FREEDOM) if noise_std else cls()

    @property
    def least(self) -> float:
        """The least standard deviation that is believed of a fit."""
        return prior.ROUNDING if self.sigma else prior.FINEST

    def variance(self, square: float | Array, n: float) -> float | Array:
        """Noise variance after a fit with this residual sum of squares."""
        mean = (self.freedom * self.sigma**2 + square) / max(self.freedom + n, 1.0)
        return np.maximum(mean, self.least**2)

    def settled(
        self,
        left: Callable[[Array], tuple[float | Array, float]],
        start: float | Array,
        ratio: float = 1.0 - prior.SETTLED_WITHIN,
    ) -> Array:
        """Noise variance after a fit whose priors are weighed by it, from a guess.

        Args:
            left: Residual sum of squares, and equations left, of the fit at a noise variance.
            start: The guess, above or below.
            ratio: Of two rounds' variances, from which on they have settled.
        """
        variance = np.asarray(start)
        for _ in range(prior.VARIANCE_ROUNDS):
            before, variance = variance, np.asarray(self.variance(*left(variance)))
            if np.all((variance >= ratio * before) & (before >= ratio * variance)):
                break
        return variance


@dataclass(frozen=True, eq=False)
class Candidate:
    """One variant of one effect, as columns of the linear problem."""

    effect: Effect  # the variant
    columns: Columns  # its columns (k,)
    log_prior: float  # log of its share among all candidates
    log_cause: float = 0.0  # log of the share of its cause, all forms of that together

    @property
    def key(self) -> tuple[str, int | None]:
        """What a verdict would call it."""
        return (self.effect.name, self.effect.element)

    @cached_property
    def limits(self) -> Array:
        """Where its parameters' bounds are from their nulls, in their scales (k, 2)."""
        declared = self.effect.parameters
        return np.array([((p.lower - p.null) / p.scale, (p.upper - p.null) / p.scale)
                         for p in declared])  # fmt: skip

    @property
    def widths(self) -> Array:
        """Widths of its prior that are tried, over its scales (S,): one alone if it is known."""
        return np.ones_like(prior.SCALES) if self.effect.plain else prior.SCALES


class Term(Protocol):
    """What may be in a model: a variant of an effect, or an unlisted mechanism."""

    @property
    def columns(self) -> Columns:
        """Its columns of the linear problem (k,)."""

    @property
    def limits(self) -> Array:
        """Lower and upper bounds of its columns' numbers, which its prior keeps to (k, 2)."""

    @property
    def widths(self) -> Array:
        """Widths of its prior that are tried, over its scales (S,)."""


@dataclass(frozen=True, eq=False)
class Scores:
    """What a scan found, one entry a candidate."""

    log_bayes: Array  # log Bayes factor against its absence (C,)
    scale: Array  # most probable scale on the grid (C,)


@dataclass(frozen=True, eq=False)
class Batch:
    """Candidates of equally many columns, gathered once and scanned many times."""

    members: Columns  # which candidates (C,)
    columns: NDArray[np.intp]  # their columns (C, k)
    blocks: Array  # their Gram blocks (C, k, k), nothing eliminated
    limits: Array  # bounds of their numbers (C, k, 2)
    widths: Array  # widths of their priors that are tried (C, S)


class Gathered(tuple[Batch, ...]):
    """Batches that are asked together, again and again."""

    @cached_property
    def asked(self) -> Columns:
        """Their columns, each once (R,)."""
        every = [batch.columns.ravel() for batch in self]
        return np.unique(np.concatenate([np.empty(0, np.intp), *every]))

    @cached_property
    def places(self) -> tuple[NDArray[np.intp], ...]:
        """Of every batch, where its columns are among these (C, k)."""
        return tuple(np.searchsorted(self.asked, batch.columns) for batch in self)


def batches(
    linear: Linear, candidates: Sequence[Term], asked: NDArray[np.intp] | None = None
) -> Gathered:
    """The candidates that are asked, all if not given, gathered by their number of columns."""
    asked = np.arange(len(candidates)) if asked is None else asked
    sizes = np.array([len(candidates[i].columns) for i in asked.tolist()], dtype=int)
    found = []
    for k in np.unique(sizes):
        members = asked[sizes == k]
        own = [candidates[int(i)] for i in members]
        columns = np.array([candidate.columns for candidate in own])
        blocks = linear.G[columns[:, :, None], columns[:, None, :]]
        limits = np.array([candidate.limits for candidate in own])
        found.append(Batch(members, columns, blocks, limits, np.array([c.widths for c in own])))
    return Gathered(found)


class Scannable(Protocol):
    """A linear problem as a scan sees it: blocks of the candidates, given what is eliminated."""

    @property
    def blocks(self) -> Sequence[Array]:
        """Gram blocks of every batch."""

    @property
    def b(self) -> Array:
        """Correlation with the target (P,)."""

    @property
    def tt(self) -> float:
        """Square of the target that is left."""

    @property
    def n(self) -> float:
        """Equations that are left."""


def scan(reduced: Scannable, gathered: Sequence[Batch], noise: NoisePrior, count: int) -> Scores:
    """Evidence for the candidates that are asked, of so many, given what has been eliminated."""
    log_bayes, scale = np.full(count, -np.inf), np.ones(count)
    if gathered:
        asked = [(blocks, reduced.b[batch.columns], batch.limits)
                 for batch, blocks in zip(gathered, reduced.blocks, strict=True)]  # fmt: skip
        widths = np.concatenate([batch.widths for batch in gathered])
        by_scale = (
            evidence_of_all(asked, reduced.tt, reduced.n, noise, widths) + prior.LOG_SCALE_WEIGHTS
        )
        members = np.concatenate([batch.members for batch in gathered])
        top = by_scale.max(axis=1)
        log_bayes[members] = top + np.log(np.exp(by_scale - top[:, None]).sum(axis=1))
        scale[members] = widths[np.arange(len(widths)), np.argmax(by_scale, axis=1)]
    return Scores(log_bayes, scale)


def block_evidence(
    blocks: Array,
    correlations: Array,
    tt: float,
    n: float,
    noise: NoisePrior,
    limits: Array | None = None,
    widths: Array = prior.SCALES,
) -> Array:
    """Log Bayes factors (C, S) of candidates of as many columns at every width that is tried.

    Args:
        blocks: Gram blocks (C, k, k).
        correlations: Correlations with the target (C, k).
        tt: Square of the target given what has been eliminated.
        n: Equations left.
        noise: The prior of the noise.
        limits: Bounds of their numbers (C, k, 2); none if not given.
        widths: Those of all candidates (S,), or of each (C, S), over their scales.
    """
    return evidence_of_all([(blocks, correlations, limits)], tt, n, noise, widths)


def evidence_of_all(
    batches: Sequence[tuple[Array, Array, Array | None]],
    tt: float,
    n: float,
    noise: NoisePrior,
    widths: Array = prior.SCALES,
) -> Array:
    """The same of several batches (blocks, correlations, limits), one behind the other (C, S).

    All their directions stand in one row: few candidates of many sizes cost no more than many
    of one.
    """
    turned = [(*_eigen(blocks), b, limits) for blocks, b, limits in batches]
    sizes = np.concatenate([np.full(*values.shape) for values, *_ in turned])
    starts = np.cumsum(sizes) - sizes
    own = [np.einsum("ckj,ck->cj", vectors, b) for _, vectors, b, _ in turned]
    beta = np.concatenate([b.ravel() for b in own])
    values = np.concatenate([values.ravel() for values, *_ in turned])
    owner = np.repeat(np.arange(len(sizes)), sizes)
    s2 = np.broadcast_to(widths, (len(sizes), widths.shape[-1])).T.take(owner, axis=1) ** 2
    weight, base = s2 * np.maximum(values, 0.0), float(noise.variance(tt, n))
    gain = s2 * beta**2

    def left(v: Array) -> tuple[Array, float]:
        each = v.take(owner, axis=1)
        each += weight
        taken = np.add.reduceat(np.divide(gain, each, out=each), starts, axis=1)
        return np.maximum(tt - taken, 0.0), n

    start = np.full((len(s2), len(sizes)), base)
    v = noise.settled(left, start, 1.0 - 100.0 * np.finfo(float).eps)
    each = v.take(owner, axis=1)
    found = -0.5 * np.add.reduceat(np.log1p(weight / each), starts, axis=1)
    found -= 0.5 * (noise.freedom + n) * np.log(v / base)
    shrunk, first, at = s2 / (each + weight), 0, 0
    far = np.add.reduceat((shrunk.max(axis=0) * beta) ** 2, starts) ** 0.5
    far += ALL * np.maximum.reduceat((shrunk * each).max(axis=0), starts) ** 0.5
    for (_, vectors, _, limits), b in zip(turned, own, strict=True):
        if limits is not None:
            found[:, first : first + len(b)] -= _of_priors(limits, s2[:, at : at + b.size])
            near = far[first : first + len(b)] > np.abs(limits).min(axis=(1, 2))
            if (some := np.flatnonzero(near)).size:
                mine = at + some[:, None] * b.shape[1] + np.arange(b.shape[1])
                moments = shrunk[:, mine] * b[some], shrunk[:, mine] * each[:, mine]
                found[:, first + some] += _inside(vectors[some], *moments, limits[some])
        first, at = first + len(b), at + b.size
    return np.asarray(found.T)


def _inside(vectors: Array, along: Array, square: Array, limits: Array) -> Array:
    """Log of the share (S, C) of posteriors within limits, of moments along directions."""
    mean = np.einsum("cij,scj->sci", vectors, along)
    std = np.sqrt(np.einsum("cij,scj->sci", vectors**2, square))
    return np.asarray(log_within(limits, mean, std).sum(axis=2))


def _of_priors(limits: Array, squares: Array) -> Array:
    """Log of the share (S, C) of priors of such variances (S, C k) within limits (C, k, 2)."""
    return _of_prior(limits.tobytes(), limits.shape, squares.tobytes())


@lru_cache(maxsize=1024)
def _of_prior(limits: bytes, shape: tuple[int, ...], squares: bytes) -> Array:
    """The same of what is asked again and again."""
    own, std = np.frombuffer(limits), np.sqrt(np.frombuffer(squares))
    return np.asarray(log_within(own.reshape(shape), 0.0, std.reshape(-1, *shape[:2])).sum(axis=2))


def log_within(limits: Array, mean: Array | float, std: Array) -> Array:
    """Log of the share (S, ...) of normal distributions within limits (..., 2)."""
    return _log_between((np.moveaxis(limits, -1, 0)[:, None] - mean) / np.maximum(std, 1e-300))


def _log_between(ends: Array) -> Array:
    """Log of a standard normal variable's probability to be between two ends (2, ...)."""
    low, high = np.clip(ends, -1e100, 1e100)
    found = np.zeros(low.shape)
    near = (low > -ALL) | (high < ALL)
    if near.any():
        low, high = low[near], high[near]
        turned = low > 0.0  # of the upper tail, by the lower one: there digits are
        one, other = np.where(turned, -low, high), np.where(turned, -high, low)
        top, two = log_ndtr(one), other**2 < one**2 + 2.0 * ALL**2  # more is rounded away
        rest = np.minimum(log_ndtr(other[two]) - top[two], -np.finfo(float).eps)
        top[two] += np.log1p(-np.exp(rest))
        found[near] = top
    return found


def _eigen(blocks: Array) -> tuple[Array, Array]:
    """Eigenvalues (C, k) and vectors (C, k, k) of symmetric blocks (C, k, k).

    Of two columns by one rotation (Golub, Van Loan 2013, Matrix Computations, sec. 8.5.2): there
    are hundreds of them.
    """
    if blocks.shape[1] == 1:
        return blocks[:, 0], np.ones_like(blocks)
    if blocks.shape[1] > 2:
        return np.linalg.eigh(blocks)
    one, cross, two = blocks[:, 0, 0], blocks[:, 1, 0], blocks[:, 1, 1]
    half = (two - one) / 2.0
    tangent = np.where(half < 0.0, -cross, cross)
    tangent = tangent / np.maximum(np.abs(half) + np.hypot(half, cross), 1e-300)
    cosine = 1.0 / np.sqrt(1.0 + tangent**2)
    sine = tangent * cosine
    values = np.stack([one - tangent * cross, two + tangent * cross], axis=1)
    vectors = np.stack([cosine, sine, -sine, cosine], axis=1).reshape(-1, 2, 2)
    return values, vectors

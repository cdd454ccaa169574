r"""The joint problem: what may be at work, and the evidence of several terms together.

With :math:`A = S G S + \sigma^2 I` of the terms' columns at their widths S, nuisances eliminated,

.. math:: \log B = -\tfrac12 \log\det (A / \sigma^2)
          - \tfrac{\nu_0 + n}{2} \log \frac{\nu_0 \sigma_0^2 + Q}{\nu_0 \sigma_0^2 + t^T t},
          \qquad Q = t^T t - b^T S A^{-1} S b

where the noise variance and the widths weigh each other until both have settled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr, logsumexp

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear, cholesky
from plumbline.optim.diagnosis.posterior.evidence import (
    Batch,
    NoisePrior,
    Scores,
    Term,
    batches,
    scan,
)
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm, stack
from plumbline.optim.diagnosis.prior import (
    FIRST_SLOT_ODDS,
    GROSS_ODDS,
    LOG_SCALE_WEIGHTS,
    NEXT_SLOT_ODDS,
    SCALE_ROUNDS,
    SCALES,
    SETTLED_VARIANCE,
    VARIANCE_ROUNDS,
)

LOG_GROSS_ODDS = float(np.log(GROSS_ODDS / (1.0 - GROSS_ODDS)))


@dataclass(frozen=True, eq=False)
class _Moved:
    """A term whose columns (k,) have other numbers."""

    columns: Columns
    sides: list[float]


@dataclass(frozen=True, eq=False)
class JointProblem:
    """What is sampled: a linear problem without nuisances, and what may be at work.

    Attributes:
        linear: The problem with the nuisances eliminated.
        terms: All terms that there may be (C).
        log_priors: Log of each term's share (C,); -inf for rows that may be gross.
        gross: Which terms are single rows that may be gross (C,).
        labels: Level by level, the number of what each term belongs to (L, C), for example its
            cause and its place; each level is counted as "any of these".
        noise: The prior of the noise.
    """

    linear: Linear
    terms: tuple[Term, ...]
    log_priors: Array
    gross: NDArray[np.bool_]
    labels: NDArray[np.intp]
    noise: NoisePrior

    @cached_property
    def gathered(self) -> list[Batch]:
        """The terms, ready to be scanned."""
        return batches(self.linear, self.terms)

    @cached_property
    def sizes(self) -> list[int]:
        """How many different labels each level has."""
        return [int(level.max(initial=-1)) + 1 for level in self.labels]

    def only(self, indices: Sequence[int]) -> JointProblem:
        """The same problem of some of its terms alone."""
        kept = [self.terms[i] for i in indices]
        columns = np.concatenate([np.empty(0, np.intp), *(t.columns for t in kept)])
        linear = self.linear
        part = Linear(linear.G[np.ix_(columns, columns)], linear.b[columns], linear.tt, linear.n)
        ends = np.cumsum([0, *(len(t.columns) for t in kept)])
        moved = tuple(
            _Moved(np.arange(a, z), t.sides) for t, (a, z) in zip(kept, pairwise(ends), strict=True)
        )
        own = list(indices)
        return JointProblem(
            part, moved, self.log_priors[own], self.gross[own], self.labels[:, own], self.noise
        )

    def reduce(self, state: Sequence[SelectedTerm], variance: float) -> Reduced:
        """What a state leaves, at the noise that it leaves."""
        if not state:
            return Reduced.nothing(self.linear, self.gathered)
        return Reduced.given(self.linear, self.gathered, self.terms, state, variance)

    def variance(self, reduced: Reduced) -> float:
        """The noise variance that a state leaves."""
        return float(self.noise.variance(reduced.tt, reduced.n))

    def settled(self, state: Sequence[SelectedTerm], variance: float) -> float:
        """The noise variance that a state leaves, whose priors are weighed by it; from a guess."""
        if not state:
            return self.variance(self.reduce([], variance))
        for _ in range(VARIANCE_ROUNDS):
            left = self.linear.left(*stack(self.terms, state, variance))
            before, variance = variance, float(self.noise.variance(*left))
            if variance > SETTLED_VARIANCE * before:
                break
        return variance

    def odds(self, reduced: Reduced) -> tuple[Array, Scores]:
        """Log odds (C,) of one term more, against none, given what is there."""
        scores = scan(reduced, self.gathered, self.noise)
        inside = [t.index for t in reduced.chosen]
        count = sum(not self.gross[i] for i in inside)
        rho = NEXT_SLOT_ODDS if count else FIRST_SLOT_ODDS
        log_odds = scores.log_bayes + self.log_priors + np.log(rho)
        log_odds[inside] = -np.inf
        return log_odds, scores


def weighed(problem: JointProblem) -> tuple[float, list[float], float]:
    """Log posterior of all terms of a problem together, their scales, and the noise variance.

    Each scale is the most probable one given the others; the sum over all of them is taken one by
    one about these.
    """
    variance = problem.variance(problem.reduce([], 1.0))
    scales = np.ones(len(problem.terms))
    now, spread = 0.0, 0.0
    for _ in range(SCALE_ROUNDS if len(scales) else 0):
        spread = 0.0
        for k in range(len(scales)):
            tried = []
            for scale in SCALES:
                scales[k] = scale
                log, found = _evidence(problem, scales, variance)
                tried.append((log, found))
            by_scale = np.array([log for log, _ in tried]) + LOG_SCALE_WEIGHTS
            best = int(np.argmax(by_scale))
            scales[k], (now, variance) = SCALES[best], tried[best]
            spread += float(logsumexp(by_scale) - by_scale[best] + LOG_SCALE_WEIGHTS[best])
    count = int((~problem.gross).sum())
    priors = np.where(problem.gross, LOG_GROSS_ODDS, problem.log_priors).sum()
    rho = np.log(FIRST_SLOT_ODDS) + (count - 1) * np.log(NEXT_SLOT_ODDS) if count else 0.0
    return float(now + spread + priors + rho), scales.tolist(), variance


def _evidence(problem: JointProblem, scales: Array, variance: float) -> tuple[float, float]:
    """Log evidence of all terms at these scales against none, and the noise that they leave."""
    linear, noise = problem.linear, problem.noise
    columns = np.concatenate([t.columns for t in problem.terms])
    s = np.repeat(scales, [len(t.columns) for t in problem.terms])
    G, b = linear.G[np.ix_(columns, columns)] * np.outer(s, s), linear.b[columns] * s
    base = float(noise.variance(linear.tt, linear.n))
    for _ in range(VARIANCE_ROUNDS):
        lower = cholesky(G + variance * np.eye(len(b)), np.diag(G))
        hidden = solve_triangular(lower, b, lower=True, check_finite=False)
        left = max(linear.tt - float(hidden @ hidden), 0.0)
        before, variance = variance, max(float(noise.variance(left, linear.n)), 1e-12 * base)
        if variance > SETTLED_VARIANCE * before:
            break
    occam = -float(np.log(np.diag(lower)).sum()) + 0.5 * len(b) * np.log(before)
    log = occam - 0.5 * (noise.freedom + linear.n) * np.log(variance / base)
    sides = np.concatenate([t.sides for t in problem.terms])
    if sides.any():
        inverse = solve_triangular(lower, np.eye(len(b)), lower=True, check_finite=False)
        mean = solve_triangular(lower, hidden, lower=True, trans="T", check_finite=False)
        std = np.sqrt(variance * (inverse**2).sum(axis=0))
        inside = np.log(2.0) + log_ndtr(sides * mean / np.maximum(std, 1e-300))
        log += float(inside[sides != 0].sum())
    return log, variance

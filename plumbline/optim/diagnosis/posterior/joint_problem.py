"""The joint problem: what may be at work, and the posterior of several terms together.

The noise variance and the widths weigh each other until both have settled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, gammaln, logit

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear
from plumbline.optim.diagnosis.posterior.evidence import (
    NoisePrior,
    Term,
    log_within,
)
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.slots import TermProblem
from plumbline.optim.diagnosis.posterior.together import Together
from plumbline.optim.diagnosis.prior import (
    ALIKE,
    DEVIATIONS,
    FIRST_SLOT_ODDS,
    GROSS_ODDS,
    LEAST_TOLD,
    LOG_SCALE_WEIGHTS,
    NEXT_SLOT_ODDS,
    ROUNDS,
    SCALES,
)

State = frozenset[int]
Evidence = Callable[[State], float]  # log of it, of some terms
LOG_GROSS_ODDS = float(np.log(GROSS_ODDS / (1.0 - GROSS_ODDS)))


def log_slot(filled: int) -> float:
    """Log odds that one slot more is filled, given so many.

    How many causes there are is geometric, and k of them are drawn in k! orders: a robot with many
    was never calibrated, and has more.
    """
    return float(np.log(min(filled * NEXT_SLOT_ODDS, FIRST_SLOT_ODDS) or FIRST_SLOT_ODDS))


@dataclass(frozen=True, eq=False)
class _Moved:
    """A term whose columns (k,) have other numbers."""

    columns: Columns
    limits: Array
    widths: Array


@dataclass(frozen=True, eq=False)
class JointProblem(TermProblem):
    """What is sampled: a linear problem without nuisances, and what may be at work."""

    linear: Linear  # the problem with the nuisances eliminated
    candidates: tuple[Term, ...]  # all terms that there may be (C)
    noise: NoisePrior  # the prior of the noise
    log_priors: Array  # log of each term's share (C,); -inf for rows that may be gross
    gross: NDArray[np.bool_]  # which terms are single rows that may be gross (C,)
    # level by level, the number of what each term belongs to (L, C), for example its cause and its
    # place; each level is counted as "any of these"
    labels: NDArray[np.intp]
    # which terms are of no effect of the library (C,); none if not given
    unlisted: NDArray[np.bool_] | None = None
    # which listed terms may be parts of an unlisted mechanism, which need not be one term
    shared: Parts | None = None
    asked: NDArray[np.intp] | None = None
    widths: Mapping[int, float] | None = None  # of a state's terms, if they are known
    of_effect: NDArray[np.intp] | None = None
    effect_shares: Array = field(default_factory=lambda: np.empty(0))

    @cached_property
    def causes(self) -> NDArray[np.intp]:
        """The labels of the first level (C,)."""
        return self.labels[0]

    def log_slot(self, filled: int) -> float:
        """As causes are counted: see the function."""
        return log_slot(filled)

    @cached_property
    def sizes(self) -> list[int]:
        """How many different labels each level has."""
        return [int(level.max(initial=-1)) + 1 for level in self.labels]

    @cached_property
    def laid_out(self) -> tuple[NDArray[np.intp], Array]:
        """Of all terms' columns, one after the other (K,): its term, and its bounds (K, 2)."""
        sizes = [len(t.columns) for t in self.candidates]
        limits = np.concatenate([t.limits for t in self.candidates])
        return np.repeat(np.arange(len(sizes)), sizes), limits

    @cached_property
    def together(self) -> Together:
        """All terms, whose columns are the linear problem's, one after the other."""
        return Together(self.linear, self.noise, *self.laid_out)

    @cached_property
    def listed(self) -> NDArray[np.bool_]:
        """Which labels of the first level are of the library (L,)."""
        found = np.zeros(self.sizes[0], dtype=bool)
        if self.unlisted is not None:
            found[self.labels[0][~self.unlisted & ~self.gross]] = True
        return found

    @cached_property
    def of_library(self) -> tuple[JointProblem, NDArray[np.intp]]:
        """The same problem, of which terms of the library alone are asked, and which these are."""
        other = self.gross if self.unlisted is None else self.unlisted | self.gross
        own = np.flatnonzero(~other)
        return replace(self, asked=own), own

    def parts(self, indices: Iterable[int]) -> Mapping[int, float]:
        """Labels of these terms that may be parts of what is unlisted, with the probability."""
        return self.shared.of(self, indices) if self.shared else {}

    def as_parts(self, states: Sequence[State], weights: Array) -> Array:
        """In what share of these states, which have something unlisted, each label is part of that.

        Of states (K,) that have the label (L,), which weigh so much (K,). The least of all, which
        hold as little as is not told, are not asked: there labels are parts as in the others.
        """
        part, whole = np.zeros((2, self.sizes[0]))
        ranked = np.argsort(-weights)
        rest = np.cumsum(weights[ranked][::-1])[::-1]
        heavy = ranked[rest > LEAST_TOLD * max(float(weights.sum()), LEAST_TOLD)]
        for k in heavy.tolist():
            whole[np.unique(self.labels[0][list(states[k])])] += weights[k]
            for i, p in self.parts(states[k]).items():
                part[i] += p * weights[k]
        return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0.0)

    def share(self, of: float) -> JointProblem:
        """The same where all rows together are worth a share of their number."""
        shared = self.shared and self.shared.share(of)
        return replace(self, linear=self.linear.share(of), shared=shared)

    def conditional(self, indices: Sequence[int], linear: Linear) -> Evidence:
        """What tells the evidence of some of these terms given the others, in another problem.

        All keep their widths, or the most probable ones of them together where none are known.
        """
        own = replace(self, linear=linear).only(indices)
        scales = [self.widths[i] for i in indices] if self.widths else weighed(own)[1]
        whole = own.reduce([SelectedTerm(k, s) for k, s in enumerate(scales)])

        def evidence(some: State) -> float:
            left, total = whole, 0.0
            asked = [t for t in whole.chosen if indices[t.index] in some]
            for k, term in enumerate(asked):
                left = left.without(asked[k - 1]) if k else left
                total += own.worth(left, term)
            return total

        return evidence

    def only(self, indices: Sequence[int]) -> JointProblem:
        """The same problem of some of its terms alone, of which none is asked."""
        kept = [self.candidates[i] for i in indices]
        columns = np.concatenate([np.empty(0, np.intp), *(t.columns for t in kept)])
        ends = np.cumsum([0, *(len(t.columns) for t in kept)])
        moved = tuple(
            _Moved(np.arange(a, z), t.limits, t.widths)
            for t, (a, z) in zip(kept, pairwise(ends), strict=True)
        )
        own = list(indices)
        return replace(
            self,
            linear=self.linear.only(columns),
            candidates=moved,
            log_priors=self.log_priors[own],
            gross=self.gross[own],
            labels=self.labels[:, own],
            unlisted=None,
            asked=np.empty(0, np.intp),
            of_effect=None if self.of_effect is None else self.of_effect[own],
        )

    def log_prior(self, indices: Sequence[int]) -> float:
        """Of these terms together, against none."""
        own = list(indices)
        mine = [i for i in own if not self.gross[i]]
        log = LOG_GROSS_ODDS * (len(own) - len(mine)) + float(self.log_priors[mine].sum())
        return log + sum(log_slot(k) for k in range(len(mine))) + self._log_alike(mine)

    def _log_alike(self, mine: Sequence[int]) -> float:
        """Log of what the urn makes of the shares of these terms, one drawn after the other."""
        if self.of_effect is None:
            return 0.0
        (held, effects), base = self.distinct(mine), ALIKE * self.effect_shares
        drawn = gammaln(base + effects) - gammaln(base) - effects * np.log(base)
        return float(drawn.sum() - np.log1p(np.arange(len(held)) / ALIKE).sum())


@dataclass(frozen=True, eq=False)
class Parts:
    """What tells parts of an unlisted mechanism from causes of their own.

    Attributes:
        prior: Probability that a listed term is a part though its place, or its driver, is another.
        apart: Of every two labels of the first level (L, L), in how many of the two they differ.
        beyond: The listed terms' problem in what no mechanism at some places could move.
    """

    prior: float
    apart: NDArray[np.intp]
    beyond: Callable[[State], Linear]
    _found: dict[State, Mapping[int, float]] = field(default_factory=dict)
    _rest: dict[State, Linear] = field(default_factory=dict)
    _logs: dict[tuple[State, State], Evidence] = field(default_factory=dict)

    def share(self, of: float) -> Parts:
        """The same where all rows together are worth a share of their number."""
        return replace(
            self, beyond=lambda at: self.beyond(at).share(of), _found={}, _rest={}, _logs={}
        )

    def of(self, problem: JointProblem, indices: Iterable[int]) -> Mapping[int, float]:
        """Labels of some terms, of the first level, that may be parts, with the probability."""
        key = frozenset(i for i in indices if not problem.gross[i])
        if key not in self._found:
            self._found[key] = self._of(problem, sorted(key))
        return self._found[key]

    def _of(self, problem: JointProblem, indices: list[int]) -> Mapping[int, float]:
        if problem.unlisted is None or not problem.unlisted[indices].any():
            return {}
        lacked = [i for i in indices if problem.unlisted[i]]
        listed = frozenset(indices).difference(lacked)
        label, place = problem.labels[:2]
        places, found, elsewhere = frozenset(place[lacked].tolist()), {}, {}
        for k in set(label[list(listed)].tolist()):
            own = frozenset(i for i in listed if label[i] == k)
            found[k] = self.prior ** float(self.apart[k, label[lacked]].min())
            if places.isdisjoint(place[list(own)].tolist()):
                elsewhere[k] = own
        moved = moved_by(problem, indices) if elsewhere else None
        least = moved(lacked) if moved else 0.0
        for k, own in elsewhere.items():
            log = np.inf  # of what is far larger
            if moved and DEVIATIONS[0] ** 2 * moved(sorted(own)) <= least:
                log = self._conditional(problem, listed, places)(own)
            found[k] = float(expit(logit(found[k]) - max(log, 0.0)))
        return found

    def _conditional(self, problem: JointProblem, listed: State, places: State) -> Evidence:
        """Of listed terms, by what no mechanism at some places could move."""
        if places not in self._rest:
            self._rest[places] = self.beyond(places)
        if (listed, places) not in self._logs:
            self._logs[listed, places] = problem.conditional(sorted(listed), self._rest[places])
        return self._logs[listed, places]


def moved_by(problem: JointProblem, indices: Sequence[int]) -> Callable[[Sequence[int]], float]:
    """The square that some of these terms move, at their fit together and usual widths."""
    linear, noise = problem.linear, problem.noise
    columns = np.concatenate([problem.candidates[i].columns for i in indices])
    ends = np.cumsum([0, *(len(problem.candidates[i].columns) for i in indices)])
    own = {i: np.arange(a, z) for i, (a, z) in zip(indices, pairwise(ends), strict=True)}
    G = linear.G[np.ix_(columns, columns)]
    values, Q = np.linalg.eigh(G)  # once for all variances
    values, c = np.maximum(values, 0.0), Q.T @ linear.b[columns]

    def left(variance: float | Array) -> tuple[float, float]:
        z = c / (values + variance)
        return max(float(linear.tt - 2.0 * z @ c + values @ z**2), 0.0), linear.n

    z = Q @ (c / (values + noise.settled(left, noise.variance(linear.tt, linear.n))))

    def square(some: Sequence[int]) -> float:
        k = np.concatenate([own[i] for i in some])
        return float(z[k] @ G[np.ix_(k, k)] @ z[k])

    return square


def weighed(problem: JointProblem) -> tuple[float, list[float], float]:
    """Log posterior of all terms of a problem together, their scales, and the noise variance.

    Each scale is the most probable one given the others; the sum over all of them is taken one by
    one about these.
    """
    variance = problem.variance([])
    scales = np.ones(len(problem.candidates))
    priors, held = _within_priors(problem, scales)
    now, spread = 0.0, 0.0
    for _ in range(ROUNDS if len(scales) else 0):
        before, spread = scales, 0.0
        for k in range(len(scales)):
            tried = np.repeat(scales[None], len(SCALES), axis=0)
            tried[:, k] = problem.candidates[k].widths
            logs, found = problem.together.evidence(tried, variance)
            logs = logs - priors[:, k] - (held.sum() - held[k])
            by_scale = logs + LOG_SCALE_WEIGHTS
            best = int(np.argmax(by_scale))
            scales, now, variance = tried[best], float(logs[best]), float(found[best])
            held[k] = priors[best, k]
            every = np.logaddexp.reduce(by_scale)
            spread += float(every - by_scale[best] + LOG_SCALE_WEIGHTS[best])
        if (scales == before).all():
            break
    prior = problem.log_prior(range(len(scales)))
    return float(now + spread + prior), scales.tolist(), variance


def stated(problem: JointProblem, state: Sequence[SelectedTerm]) -> float:
    """Log posterior of a state at the scales that it has, against the empty one."""
    if not state:
        return 0.0
    own = problem.only([t.index for t in state])
    scales = np.array([[t.scale for t in state]])
    variance = problem.variance(state)
    told = np.array([np.ptp(term.widths) > 0.0 for term in own.candidates])
    widths = np.interp(np.log(scales[0]), np.log(SCALES), LOG_SCALE_WEIGHTS)[told].sum()
    evidence = float(own.together.evidence(scales, variance)[0][0])
    evidence -= float(_within_priors(own, scales[0])[1].sum())
    return evidence + float(widths) + own.log_prior(range(len(state)))


def _within_priors(problem: JointProblem, scales: Array) -> tuple[Array, Array]:
    """Log of the share of every term's prior within its limits, at its widths (S, C) and a scale.

    The latter are (C,).
    """
    if not len(scales):
        return np.empty((len(SCALES), 0)), scales
    owner, limits = problem.laid_out
    widths = np.array([term.widths for term in problem.candidates]).T
    each = log_within(limits, 0.0, np.vstack([widths, scales])[:, owner])
    starts = np.searchsorted(owner, np.arange(len(scales)))
    found = np.add.reduceat(each, starts, axis=1)
    return found[:-1], found[-1]

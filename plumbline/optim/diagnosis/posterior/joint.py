r"""One posterior over what may be at work: library causes, unlisted mechanisms and gross rows.

About the fit, nuisances eliminated, the residual is a sum of terms, each of which may be absent,

.. math:: t = \sum_{c \in M} X_c z_c + \varepsilon, \qquad z_c \sim N(0, s_c^2), \qquad
          p(M) = \rho_1 \cdots \rho_n \prod_{c \in M} w_c

and the set M with its scales s is sampled. One move takes a term out at random and asks what
fills its place, if anything; the other asks whether one more is there. With n terms after it, what
the second adds is accepted with probability 1/n, which makes the two a Markov chain whose
stationary distribution is the posterior (Hastings 1970). The chains find what states there are;
marginals are sums over all states that they have been in, or that have one term more, each with its
own weight (Clyde, Ghosh and Littman 2011, J. Comput. Graph. Stat. 20:80), so that a probability
does not depend on luck.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import expit, log_ndtr, logsumexp

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
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm
from plumbline.optim.diagnosis.prior import (
    CHAINS_APART,
    FIRST_SLOT_ODDS,
    GROSS_ODDS,
    GROSS_TURN,
    LOG_SCALE_WEIGHTS,
    MOST_TERMS,
    MOVES,
    NEARLY_NOTHING,
    NEXT_SLOT_ODDS,
    SCALE_ROUNDS,
    SCALES,
    SETTLED_VARIANCE,
    TILT,
    VARIANCE_ROUNDS,
)

State = frozenset[int]
LEAST_HEARD = float(np.log(CHAINS_APART))  # of a chain's weight, log of that of the best
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
        for _ in range(VARIANCE_ROUNDS):
            before, variance = variance, self.variance(self.reduce(state, variance))
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


@dataclass(frozen=True, eq=False)
class Sampled:
    """What one chain, or several together, have found.

    Attributes:
        marginals: Probability of every label, level by level.
        gross: Probability of every term as a gross row (C,).
        states: States that were visited, with their log posterior, best first.
        sensitive: Probability of every label of the first level with prior odds of every term a
            third, and three times as high (2, labels).
        apart: The most by which chains disagree about a label of the first level.
    """

    marginals: tuple[Array, ...]
    gross: Array
    states: tuple[tuple[float, tuple[SelectedTerm, ...]], ...]
    sensitive: Array
    apart: float = 0.0


class _Chain:
    """A state on its way, and what every state near its path weighs.

    Attributes:
        problem: What is sampled.
        rng: Of its moves.
        state: Where it is.
        looks: What has been worked out of states, by any chain.
        seen: Log posterior of the states that were asked, and of all that have one term more.
    """

    def __init__(
        self,
        problem: JointProblem,
        rng: np.random.Generator,
        state: State,
        looks: dict[State, _Look],
    ) -> None:
        """At its start."""
        self.problem, self.rng, self.state, self.looks = problem, rng, state, looks
        self.seen: dict[State, float] = {}

    def run(self, moves: int) -> None:
        """From its start on: first to the best that is near, then at random."""
        while len(self.state) < MOST_TERMS:
            log_odds = self._look(self.state).log_odds
            if not log_odds.max(initial=-np.inf) > 0.0:
                break
            self.state = self.state | {int(np.argmax(log_odds))}
        for _ in range(moves):
            self._move()

    def _move(self) -> None:
        mine = sorted(i for i in self.state if not self.problem.gross[i])
        if self.problem.gross.any() and self.rng.random() < GROSS_TURN:
            self._ask_a_row() if self.rng.random() < 0.5 else self._ask_all_rows()
        elif mine and (len(mine) >= MOST_TERMS or self.rng.random() < 0.5):
            self._fill(self.state - {mine[int(self.rng.integers(len(mine)))]}, 1.0)
        else:
            self._fill(self.state, 1.0 / (1 + len(mine)))

    def _fill(self, rest: State, accepted: float) -> None:
        """Draw what fills the place beside these terms, if anything."""
        shares = _shares(self._look(rest).log_odds)
        drawn = int(np.searchsorted(np.cumsum(shares), self.rng.random()))
        if drawn >= len(shares):
            self.state = rest
        elif self.rng.random() < accepted:
            self.state = rest | {drawn}

    def _look(self, state: State) -> _Look:
        """What is known of a state; what it says of those near by is kept."""
        if state not in self.looks:
            self.looks[state] = look_at(self.problem, state)
        look = self.looks[state]
        self.seen[state] = look.log_posterior
        near = look.log_posterior + np.where(self.problem.gross, look.row_odds, look.log_odds)
        for i in np.flatnonzero(near > max(self.seen.values()) - NEARLY_NOTHING).tolist():
            self._see(state | {i}, float(near[i]))
        return look

    def _see(self, state: State, log: float) -> None:
        """Keep what a neighbour says of a state, unless it has been looked at itself."""
        looked = self.looks.get(state)
        log = log if looked is None else looked.log_posterior
        self.seen[state] = max(self.seen.get(state, -np.inf), log) if looked is None else log

    def _ask_all_rows(self) -> None:
        """All rows gross, or none and one term that may explain them together."""
        rows = frozenset(np.flatnonzero(self.problem.gross).tolist())
        rest = self.state - rows
        alone, instead = self._look(rest | rows), self._look(rest)
        odds = np.append(instead.log_odds, alone.log_posterior - instead.log_posterior)
        drawn = int(np.searchsorted(np.cumsum(_shares(odds)), self.rng.random()))
        told = len(odds) - 1
        self.state = rest | rows if drawn == told else rest | ({drawn} if drawn < told else set())

    def _ask_a_row(self) -> None:
        row = {int(self.rng.choice(np.flatnonzero(self.problem.gross)))}
        without, having = self._look(self.state - row), self._look(self.state | row)
        log_odds = having.log_posterior - without.log_posterior
        self.state = self.state | row if self.rng.random() < expit(log_odds) else self.state - row


@dataclass(frozen=True, eq=False)
class _Look:
    """A state, looked at.

    Attributes:
        terms: Its terms, each at its most probable scale given those before it.
        log_posterior: Against the empty state.
        log_odds: Of every term more (C,), against none.
        row_odds: Of every row more that may be gross (C,), against none.
    """

    terms: tuple[SelectedTerm, ...]
    log_posterior: float
    log_odds: Array
    row_odds: Array


def look_at(problem: JointProblem, state: State) -> _Look:
    """A state's posterior, and the odds of one term more."""
    indices = sorted(state)
    small = problem.only(indices)
    total, scales, variance = _weighed(small)
    terms = tuple(SelectedTerm(i, s) for i, s in zip(indices, scales, strict=True))
    log_odds, scores = problem.odds(problem.reduce(terms, variance))
    rows = scores.log_bayes + LOG_GROSS_ODDS
    rows[indices] = -np.inf
    return _Look(terms, total, log_odds, rows)


def _weighed(problem: JointProblem) -> tuple[float, list[float], float]:
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


def _shares(log_odds: Array) -> Array:
    """Probability of every term in one place (C,); what is missing to 1 is emptiness."""
    return np.asarray(np.exp(log_odds - np.logaddexp(0.0, logsumexp(log_odds))))


def sample(
    problem: JointProblem, starts: Sequence[State], seed: int, moves: int = MOVES
) -> Sampled:
    """The posterior, as what chains from several starts have come by.

    Args:
        problem: What is sampled.
        starts: The states from which the chains start.
        seed: Of the chains.
        moves: Of each chain.
    """
    looks: dict[State, _Look] = {}
    chains = [
        _Chain(problem, np.random.default_rng([seed, k]), start, looks)
        for k, start in enumerate(starts)
    ]
    for chain in chains:
        chain.run(moves)
    seen: dict[State, float] = {}
    for chain in chains:
        for key, log in chain.seen.items():
            looked = looks.get(key)
            seen[key] = looked.log_posterior if looked else max(seen.get(key, -np.inf), log)
    marginals, gross = _marginals(problem, seen)
    # A chain that holds next to nothing of what all have found has no say.
    logs = np.array([logsumexp(list(chain.seen.values())) for chain in chains])
    heard = [c for c, log in zip(chains, logs, strict=True) if log > logs.max() + LEAST_HEARD]
    each = np.stack([_marginals(problem, chain.seen)[0][0] for chain in heard])
    ranked = sorted(looks.values(), key=lambda look: -look.log_posterior)
    states = tuple((look.log_posterior, look.terms) for look in ranked)
    tilted = [_marginals(problem, seen, log)[0][0] for log in (-np.log(TILT), np.log(TILT))]
    apart = float(np.ptp(each, axis=0).max(initial=0.0))
    return Sampled(marginals, gross, states, np.stack(tilted), apart)


def _marginals(
    problem: JointProblem, seen: Mapping[State, float], tilt: float = 0.0
) -> tuple[tuple[Array, ...], Array]:
    """Probability of every label, level by level, and of every term as a gross row.

    Args:
        problem: What was sampled.
        seen: Log posterior of every state.
        tilt: Log odds by which every term is more probable than the prior has it.
    """
    logs = np.array([log + tilt * len(key) for key, log in seen.items()])
    weights = np.exp(logs - logsumexp(logs))
    found = [np.zeros(size) for size in problem.sizes]
    levels = [level.tolist() for level in problem.labels]
    gross = np.zeros(len(problem.terms))
    for weight, key in zip(weights.tolist(), seen, strict=True):
        mine = [i for i in key if not problem.gross[i]]
        for i in key.difference(mine):
            gross[i] += weight
        for level, total in zip(levels, found, strict=True):
            for label in {level[i] for i in mine}:
                total[label] += weight
    return tuple(np.minimum(total, 1.0) for total in found), np.minimum(gross, 1.0)


def term_by_term(problem: JointProblem, state: Sequence[SelectedTerm]) -> Sampled:
    """The same where a state is so long that its terms are asked one by one about it, once.

    The state stays; each of its terms is kept, replaced or dropped given all others, and one more
    is asked for. What several terms of a label say is that any of them is there.
    """
    variance = problem.settled(state, problem.variance(problem.reduce([], 1.0)))
    reduced = problem.reduce(state, variance)
    absent = [np.ones(size) for size in problem.sizes]
    more = _shares(problem.odds(reduced)[0])
    asked = [more]
    for term in state:
        if not problem.gross[term.index]:
            asked.append(_shares(problem.odds(reduced.without(term))[0]))
    for shares in asked:
        for level, left in zip(problem.labels, absent, strict=True):
            left *= 1.0 - np.minimum(np.bincount(level, shares, len(left)), 1.0)
    gross = np.zeros(len(problem.terms))
    gross[[t.index for t in state if problem.gross[t.index]]] = 1.0
    found = tuple(1.0 - a for a in absent)
    return Sampled(found, gross, ((0.0, tuple(state)),), np.stack([found[0], found[0]]))

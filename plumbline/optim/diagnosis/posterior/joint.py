r"""One posterior over what may be at work: library causes, unlisted mechanisms and gross rows.

About the fit, nuisances eliminated, the residual is a sum of terms, each of which may be absent,

.. math:: t = \sum_{c \in M} X_c z_c + \varepsilon, \qquad z_c \sim N(0, s_c^2), \qquad
          p(M) = \rho_1 \cdots \rho_n \prod_{c \in M} w_c

and the set M with its scales s is sampled. One move takes a term out at random and asks what
fills its place, if anything; the other asks whether one more is there. With n terms after it, what
the second adds is accepted with probability 1/n, which makes the two a Markov chain whose
stationary distribution is the posterior (Hastings 1970). A third asks two listed terms for one, or
one for two: of two that are worth little alone neither would go in first. The chains find what
states there are; marginals are sums over all states that they have been in, or that have one term
more, each with its own weight (Clyde, Ghosh and Littman 2011, J. Comput. Graph. Stat. 20:80), so
that a probability does not depend on luck.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.posterior.evidence import Scores
from plumbline.optim.diagnosis.posterior.joint_problem import LOG_GROSS_ODDS, JointProblem, weighed
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.slots import shares_of

State = frozenset[int]
LEAST_HEARD = float(np.log(prior.LEAST_TOLD))  # of a chain's weight, log of that of the best


@dataclass(frozen=True, eq=False)
class Sampled:
    """What one chain, or several together, have found."""

    marginals: tuple[Array, ...]  # probability of every label, level by level
    gross: Array  # probability of every term as a gross row (C,)
    # states that were visited, with their log posterior, best first
    states: tuple[tuple[float, tuple[SelectedTerm, ...]], ...]
    # probability of every label of the first level with prior odds of every term a third, and three
    # times as high (2, labels)
    sensitive: Array
    apart: float = 0.0  # the most by which chains disagree about a label of the first level
    # log posterior of every state that counts; empty where terms were asked one by one
    seen: Mapping[State, float] = field(default_factory=dict)

    def given(self, problem: JointProblem, labels: Iterable[int]) -> tuple[Array, ...] | None:
        """The marginals of the states that hold all these labels of the first level, if any do."""
        held = self._holding(problem, labels)
        return _marginals(problem, held)[0] if held else None

    def named(self, problem: JointProblem, kinds: Array) -> list[int]:
        """Listed labels to name: one after the other, each more probable than not given the others.

        Several may do the same: the most probable is named with the share that it has where one of
        its kind is more probable than not, or it is settled that one more is at work.

        Args:
            problem: What was sampled.
            kinds: Of every label of the first level (L,): those of one kind depend on the same.
        """
        alone = np.where(problem.listed, self.marginals[0], 0.0)
        if not self.seen:
            return np.flatnonzero(alone >= prior.LEAST_NAMED).tolist()
        every = np.ones(len(kinds), dtype=bool)

        def one_more(found: Sequence[int], kind: float) -> bool:
            of_kind = self._one_more(problem, found, kinds == kind, prior.LEAST_NAMED)
            return of_kind or self._one_more(problem, found, every, prior.SETTLED)

        found: list[int] = []
        while (marginals := self.given(problem, found)) is not None:
            p = np.minimum(alone, marginals[0])
            p[found] = 0.0
            best = int(np.argmax(p))
            if p[best] < prior.LEAST_NAMED and not (p[best] and one_more(found, kinds[best])):
                break
            found.append(best)
        return found

    def _holding(self, problem: JointProblem, labels: Iterable[int]) -> dict[State, float]:
        wanted = frozenset(labels)
        return {s: log for s, log in self.seen.items() if wanted <= self._labels(problem, s)}

    def _one_more(
        self, problem: JointProblem, found: Sequence[int], among: NDArray[np.bool_], least: float
    ) -> bool:
        """Whether a listed label among some (L,) is at work with those found, as probably as that.

        What may be a part of an unlisted mechanism does not count. States are asked, the most
        probable first, until the others make no difference.
        """
        wanted = frozenset(np.flatnonzero(problem.listed & among).tolist()).difference(found)
        held = sorted(self._holding(problem, found).items(), key=lambda seen: -seen[1])
        weights = np.exp(np.array([log for _, log in held]) - held[0][1])
        sure, open_ = 0.0, 1.0
        for (state, _), weight in zip(held, (weights / weights.sum()).tolist(), strict=True):
            if sure >= least or sure + open_ < least:
                break
            more = wanted & self._labels(problem, state)
            sure += weight if more and more.difference(problem.parts(state)) else 0.0
            open_ -= weight
        return sure >= least

    @staticmethod
    def _labels(problem: JointProblem, state: State) -> set[int]:
        return {int(problem.labels[0][i]) for i in state if not problem.gross[i]}


class MarkovChain:
    """A state on its way.

    Attributes:
        problem: What is sampled.
        rng: Of its moves.
        state: Where it is.
        looks: What has been worked out of states, by any chain.
        been: The states that were asked, and what was found.
    """

    def __init__(
        self,
        problem: JointProblem,
        rng: np.random.Generator,
        state: State,
        looks: dict[State, _Look],
    ) -> None:
        self.problem, self.rng, self.state, self.looks = problem, rng, state, looks
        self.been: dict[State, _Look] = {}
        # More terms than equations say nothing.
        self.most = min(2 * prior.MANY_CAUSES, max(int(problem.linear.n), 1))

    def run(self, moves: int) -> None:
        """From its start on: first to the best that is near, then at random."""
        while len(self.state) < self.most:
            log_odds = self._look(self.state).odds[0]
            if not log_odds.max(initial=-np.inf) > 0.0:
                break
            self.state = self.state | {int(np.argmax(log_odds))}
        for _ in range(moves):
            self._move()

    def _move(self) -> None:
        mine = sorted(i for i in self.state if not self.problem.gross[i])
        if self.problem.gross.any() and self.rng.random() < prior.OTHER_MOVES:
            self._ask_a_row() if self.rng.random() < 0.5 else self._ask_all_rows()
        elif 0 < len(mine) < self.most and self.rng.random() < prior.OTHER_MOVES:
            self._part(mine) if self.rng.random() < 0.5 else self._join(mine)
        elif mine and (len(mine) >= self.most or self.rng.random() < 0.5):
            self._fill(self.state - {mine[int(self.rng.integers(len(mine)))]}, 1.0)
        else:
            self._fill(self.state, 1.0 / (1 + len(mine)))

    def _fill(self, rest: State, accepted: float) -> None:
        """Draw what fills the place given these terms, if anything."""
        up_to = self._look(rest).up_to
        drawn = int(np.searchsorted(up_to, self.rng.random()))
        if drawn >= len(up_to):
            self.state = rest
        elif self.rng.random() < accepted:
            self.state = rest | {drawn}

    def _part(self, mine: Sequence[int]) -> None:
        """Ask two listed terms for one."""
        one = mine[int(self.rng.integers(len(mine)))]
        pairs = self._look(self.state - {one}).pairs
        if pairs and len(mine) + 1 < self.most:
            two = list(pairs)[int(self.rng.choice(len(pairs), p=[*pairs.values()]))]
            self._exchange(self.state - {one}, one, two, len(mine), 1.0)

    def _join(self, mine: Sequence[int]) -> None:
        """Ask one term for two."""
        two = frozenset(self.rng.choice(mine, min(len(mine), 2), replace=False).tolist())
        one = int(np.searchsorted(self._look(self.state - two).up_to, self.rng.random()))
        if len(two) == 2 and one < len(self.problem.candidates):
            self._exchange(self.state - two, one, two, len(mine) - 1, -1.0)

    def _exchange(self, rest: State, one: int, two: State, filled: int, sign: float) -> None:
        """Two terms for one of so many, or back where the sign is so (Metropolis-Hastings)."""
        look, new = self._look(rest), rest | (two if sign > 0.0 else {one})
        gained = self._look(rest | two).log_posterior - self._look(rest | {one}).log_posterior
        with np.errstate(divide="ignore"):  # of what is never asked
            asked = np.log([shares_of(look.odds[0])[one], look.pairs.get(two, 0.0)])
        log = gained + float(asked[0] - asked[1] + np.log(2.0 / (filled + 1)))
        if np.log(self.rng.random()) < sign * log:
            self.state = new

    def two_for_two(self) -> None:
        """Ask two terms for two, one drawn after the other (Metropolis-Hastings)."""
        mine = sorted(i for i in self.state if not self.problem.gross[i])
        old = frozenset(self.rng.choice(mine, min(len(mine), 2), replace=False).tolist())
        rest, new = self.state - old, frozenset[int]()
        for _ in old:
            drawn = np.searchsorted(self._look(rest | new).up_to, self.rng.random())
            new |= {int(drawn)}.intersection(range(len(self.problem.candidates)))

        def log_weight(pair: State) -> float:
            orders = (pair, tuple(pair)[::-1])
            logs = [self._log_share(rest, i) + self._log_share(rest | {i}, k) for i, k in orders]
            return self._look(rest | pair).log_posterior - float(np.logaddexp.reduce(logs))

        if len(old) == 2 == len(new):
            accepted = np.log(self.rng.random()) < log_weight(new) - log_weight(old)
            self.state = rest | (new if accepted else old)

    def _log_share(self, rest: State, term: int) -> float:
        log_odds = self._look(rest).odds[0]  # that it fills one place beside these
        return float(log_odds[term] - np.logaddexp.reduce(log_odds, initial=0.0))

    def _look(self, state: State) -> _Look:
        """What is known of a state."""
        if state not in self.looks:
            self.looks[state] = look_at(self.problem, state)
        self.been[state] = self.looks[state]
        return self.looks[state]

    def _ask_all_rows(self) -> None:
        """All rows gross, or none and one term that may explain them together."""
        rows = frozenset(np.flatnonzero(self.problem.gross).tolist())
        rest = self.state - rows
        alone, instead = self._look(rest | rows), self._look(rest)
        odds = np.append(instead.odds[0], alone.log_posterior - instead.log_posterior)
        drawn = int(np.searchsorted(np.cumsum(shares_of(odds)), self.rng.random()))
        told = len(odds) - 1
        self.state = rest | rows if drawn == told else rest | ({drawn} if drawn < told else set())

    def _ask_a_row(self) -> None:
        row = {int(self.rng.choice(np.flatnonzero(self.problem.gross)))}
        without, having = self._look(self.state - row), self._look(self.state | row)
        log_odds = having.log_posterior - without.log_posterior
        self.state = self.state | row if self.rng.random() < expit(log_odds) else self.state - row


@dataclass(frozen=True, eq=False)
class _Look:
    """A state, looked at."""

    problem: JointProblem
    # its terms, each at its most probable scale given those before it
    terms: tuple[SelectedTerm, ...]
    log_posterior: float  # against the empty state

    @cached_property
    def asked(self) -> tuple[Array, Scores]:
        """Log odds (C,) of every term more to none, and its scores."""
        return self.problem.odds(self.problem.reduce(self.terms))

    @cached_property
    def odds(self) -> tuple[Array, Array]:
        """Log odds of every term more, and of every row more that may be gross (C,), to none."""
        log_odds, scores = self.asked
        rows = np.where(self.problem.gross, scores.log_bayes + LOG_GROSS_ODDS, -np.inf)
        rows[[term.index for term in self.terms]] = -np.inf
        return log_odds, rows

    @cached_property
    def near(self) -> Array:
        """Log posterior of this state with each term, or row, more (C,)."""
        return np.asarray(self.log_posterior + np.maximum(*self.odds))

    @cached_property
    def up_to(self) -> Array:
        """Probability that one of the terms up to each fills one place (C,)."""
        return np.cumsum(shares_of(self.odds[0]))

    @cached_property
    def pairs(self) -> Mapping[State, float]:
        """Of pairs of listed terms, the probability that they fill two places.

        One of a pair is among the first to fill one place.
        """
        (listed, own), (log_odds, scores) = self.problem.of_library, self.asked
        found = defaultdict[State, float](lambda: -np.inf)
        for i in own[np.argsort(-log_odds[own], kind="stable")[: prior.PAIRED]].tolist():
            both = listed.reduce([*self.terms, SelectedTerm(i, float(scores.scale[i]))])
            logs = log_odds[i] + listed.odds(both)[0]
            least = logs.max(initial=-np.inf) - prior.NEARLY_NOTHING
            for k in np.flatnonzero(logs > least).tolist():
                found[frozenset((i, k))] = np.logaddexp(found[frozenset((i, k))], logs[k])
        logs = np.array([*found.values()])
        return dict(zip(found, np.exp(logs - np.logaddexp.reduce(logs)).tolist(), strict=True))


def look_at(problem: JointProblem, state: State) -> _Look:
    """A state's posterior."""
    indices = sorted(state)
    total, scales, _ = weighed(problem.only(indices))
    terms = tuple(SelectedTerm(i, s) for i, s in zip(indices, scales, strict=True))
    return _Look(problem, terms, total)


def sample(
    problem: JointProblem, starts: Sequence[State], seed: int, moves: int = prior.MOVES
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
        MarkovChain(problem, np.random.default_rng([seed, k]), start, looks)
        for k, start in enumerate(starts)
    ]
    for one in chains:
        one.run(moves)
    best = max(look.log_posterior for look in looks.values()) + LEAST_HEARD
    swapped = {s: [*_swapped(problem, k)] for s, k in looks.items() if k.log_posterior >= best}
    seen = _seen(looks, swapped)
    marginals, gross = _marginals(problem, seen)
    # A chain that holds next to nothing of what all have found has no say.
    own = [_seen(one.been, swapped) for one in chains]
    logs = np.array([np.logaddexp.reduce(list(found.values())) for found in own])
    heard = [f for f, log in zip(own, logs, strict=True) if log > logs.max() + LEAST_HEARD]
    each = np.stack([_marginals(problem, found)[0][0] for found in heard])
    ranked = sorted(looks.values(), key=lambda look: -look.log_posterior)
    states = tuple((look.log_posterior, look.terms) for look in ranked)
    tilted = [
        _marginals(problem, seen, log)[0][0] for log in (-np.log(prior.TILT), np.log(prior.TILT))
    ]
    apart = float(np.ptp(each, axis=0).max(initial=0.0))
    return Sampled(marginals, gross, states, np.stack(tilted), apart, seen)


def _swapped(problem: JointProblem, look: _Look) -> Iterator[tuple[State, float]]:
    """States with another term in the place of one, and their log posterior, by all other widths.

    What one more makes of a state is worked out at the widths that the others have without it: by
    that alone, what was asked would weigh more than what does as well.
    """
    whole = problem.reduce(look.terms)
    for term in problem.slots(look.terms):
        log_odds, _ = problem.odds(whole.without(term))
        gained = log_odds - log_odds[term.index]
        rest = frozenset(t.index for t in look.terms) - {term.index}
        for i in np.flatnonzero(gained > -prior.NEARLY_NOTHING).tolist():
            yield rest | {i}, look.log_posterior + float(gained[i])


def _seen(
    looks: Mapping[State, _Look], swapped: Mapping[State, Sequence[tuple[State, float]]]
) -> dict[State, float]:
    """Log posterior of states that were asked, and of what is near: a term more, or another.

    Args:
        looks: The states.
        swapped: Of some of them, states with another term in the place of one.
    """
    least = max(look.log_posterior for look in looks.values()) - prior.NEARLY_NOTHING
    seen: dict[State, float] = {}
    for state, look in looks.items():
        more = np.flatnonzero(look.near > least).tolist()
        found = [(state | {i}, float(look.near[i])) for i in more]
        for key, log in (*found, *swapped.get(state, ())):
            seen[key] = max(seen.get(key, -np.inf), log)
    return seen | {state: look.log_posterior for state, look in looks.items()}


def _marginals(
    problem: JointProblem, seen: Mapping[State, float], tilt: float = 0.0
) -> tuple[tuple[Array, ...], Array]:
    """Probability of every label, level by level, and of every term as a gross row.

    Args:
        problem: What was sampled.
        seen: Log posterior of every state.
        tilt: Log odds by which every term is more probable than the prior has it.
    """
    sizes = np.fromiter(map(len, seen), dtype=int, count=len(seen))
    logs = np.fromiter(seen.values(), dtype=float, count=len(seen)) + tilt * sizes
    weights = np.exp(logs - np.logaddexp.reduce(logs))
    held = np.fromiter(chain.from_iterable(seen), dtype=int, count=int(sizes.sum()))
    owner, is_gross = np.repeat(np.arange(len(seen)), sizes), problem.gross[held]
    gross = np.bincount(held[is_gross], weights[owner[is_gross]], len(problem.candidates))
    held, owner = held[~is_gross], owner[~is_gross]
    found: list[Array] = []
    for level, size in zip(problem.labels, problem.sizes, strict=True):
        at, label = np.divmod(np.unique(owner * size + level[held]), size)
        found.append(np.asarray(np.bincount(label, weights[at], size), dtype=float))
    if problem.unlisted is not None:
        having = np.unique(owner[problem.unlisted[held]])
        states = list(seen)
        share = problem.as_parts([states[k] for k in having.tolist()], weights[having])
        beside, size = np.isin(owner, having), problem.sizes[0]
        pairs = np.unique(owner[beside] * size + problem.labels[0][held[beside]])
        at, label = np.divmod(pairs, size)
        found[0] -= share * np.bincount(label, weights[at], size)
    return tuple(np.minimum(total, 1.0) for total in found), np.minimum(gross, 1.0)

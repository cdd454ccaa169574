r"""Of many causes: the best states near by, chains of states from there, and what each term is.

A state too long to be sampled whole is climbed: what the state lacks is added, and then slot after
slot is asked what fills it, given all others,

.. math:: p(c \mid M \setminus e) = \frac{w_c B_c}{1 + \sum_d w_d B_d},

and kept, filled otherwise or emptied, until nothing changes (iterated conditional modes, Besag
1986, J. R. Stat. Soc. B 48(3)). What the library lacks goes in first: a slot that is asked while
something else is missing is asked for both. One term goes at a time, so that of two that are
confounded one stays. A climb ends in one of many states that say nearly the same and is sure of
it; a chain draws from these shares instead (Geman and Geman 1984, IEEE TPAMI 6(6)), and all that it
asks on its way is summed over.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.core.side_by_side import side_by_side
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.posterior.joint import LEAST_HEARD, MarkovChain, Sampled
from plumbline.optim.diagnosis.posterior.joint_problem import (
    JointProblem,
    Parts,
    log_slot,
    stated,
)
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm
from plumbline.optim.diagnosis.posterior.slots import climbed, extended, shares_of

# What has been asked conditional on sets of terms: log odds and scales (C,) of one more.
Asked = dict[frozenset[SelectedTerm], tuple[Array, Array]]


def best_near(problem: JointProblem, state: Sequence[SelectedTerm]) -> tuple[SelectedTerm, ...]:
    """The best state near a long one, or that itself. Rows that this takes for gross stay so."""
    end = climbed(problem, extended(problem, _thinned(problem, state)), prior.ROUNDS)
    return max(tuple(state), tuple(end), key=lambda some: stated(problem, some))


def coarsened(
    problem: JointProblem, state: Sequence[SelectedTerm], power: float, seed: int
) -> Sampled:
    """Sampled by a power of the likelihood, a share of what the rows say, by two chains.

    They start at the best of three climbs' ends, and at another if it is as good but for chance:
    from the state downwards, from its listed terms, whose places nothing else then holds, and from
    its gross rows upwards. Chains that do not cross count by their starts. What is next to
    nothing in all places of these is not asked again.
    """
    problem = problem.share(power)
    gross = [t for t in state if problem.gross[t.index]]
    none = problem.unlisted
    listed = state if none is None else [t for t in state if not none[t.index]]
    ends = side_by_side(partial(best_near, problem), (state, listed, gross))
    logs = np.array([stated(problem, end) for end in ends])
    near = [k for k in np.argsort(-logs) if logs[k] > logs.max() + LEAST_HEARD]
    starts = [near[0], near[-1]]
    shares = [_largest(problem, ends[k]) for k in starts]
    problem = replace(problem, asked=np.flatnonzero(np.max(shares, axis=0) >= prior.LEAST_ASKED))

    def chained(k: int) -> Sampled:
        pairs = MarkovChain(problem, np.random.default_rng([seed, k]), frozenset(), {})
        return _chain(pairs, ends[starts[k]])

    chains = side_by_side(chained, range(len(starts)))
    apart = np.ptp([chain.marginals[0] for chain in chains], axis=0)
    weights = np.exp(logs[starts] - logs.max())
    return replace(_mean(chains, weights), apart=float(apart.max(initial=0.0)))


def _largest(problem: JointProblem, state: Sequence[SelectedTerm]) -> Array:
    """The largest share (C,) that every term has in any place of a state."""
    whole = problem.reduce(state)
    places = [whole, *(whole.without(term) for term in problem.slots(state))]
    return np.max([shares_of(problem.odds(reduced)[0]) for reduced in places], axis=0)


def _chain(pairs: MarkovChain, state: Sequence[SelectedTerm]) -> Sampled:
    """What sweeps say together, each of every place of a state and an empty one, in any order.

    Between them two terms go for two: pairs that do the same as others a chain would never leave.
    """
    problem, rng, sweeps, moves, asked = pairs.problem, pairs.rng, list[Sampled](), 0, Asked()
    while moves < prior.LONG_MOVES:
        reduced, odds = problem.reduce(state), []
        places: list[list[SelectedTerm]] = [[], *([t] for t in problem.slots(state))]
        for k in rng.permutation(len(places)).tolist():
            log_odds, reduced = _redrawn(problem, reduced, places[k], rng, asked)
            odds.append(log_odds)
        sweeps.append(_said(problem, state, odds))
        state, moves = reduced.chosen, moves + len(places)
        if (
            len(places) <= 2 * prior.MANY_CAUSES
        ):  # of more it would take too long to weigh all together
            state = _exchanged(pairs, state, rng.binomial(len(places), prior.OTHER_MOVES))
    return _mean(sweeps)


def _exchanged(
    chain: MarkovChain, state: Sequence[SelectedTerm], moves: int
) -> Sequence[SelectedTerm]:
    """A state after so many exchanges of two terms for two."""
    chain.state = before = frozenset(term.index for term in state)
    for _ in range(moves):
        chain.two_for_two()
    return state if chain.state == before else chain.looks[chain.state].terms


def _redrawn(
    problem: JointProblem,
    reduced: Reduced,
    old: Sequence[SelectedTerm],
    rng: np.random.Generator,
    asked: Asked,
) -> tuple[Array, Reduced]:
    """Log odds (C,) of what fills one place, a term's or none's, and the state with what does."""
    rest = frozenset(reduced.chosen).difference(old)
    if rest not in asked:
        log_odds, scores = problem.odds(reduced.without(old[0]) if old else reduced)
        asked[rest] = log_odds, scores.scale
    log_odds, scale = asked[rest]
    drawn = int(np.searchsorted(np.cumsum(shares_of(log_odds)), rng.random()))
    new = [SelectedTerm(k, float(scale[k])) for k in range(len(scale))[drawn:][:1]]
    if list(old) != new:  # worked out anew: errors of one update after the other grow
        kept = [t for t in reduced.chosen if t not in old]
        reduced = problem.reduce([*kept, *new], near=reduced)
    return log_odds, reduced


def _said(problem: JointProblem, state: Sequence[SelectedTerm], odds: Sequence[Array]) -> Sampled:
    """Probabilities by what one sweep asked from a state on."""
    held, tilt = {t.index: t.scale for t in problem.slots(state)}, float(np.log(prior.TILT))
    found, *tilted = (
        _marginals(problem, [log + t for log in odds], held) for t in (0.0, -tilt, tilt)
    )
    gross = np.zeros(len(problem.candidates))
    gross[[t.index for t in state if problem.gross[t.index]]] = 1.0
    states = ((stated(problem, state), tuple(state)),)
    return Sampled(found, gross, states, np.stack([levels[0] for levels in tilted]))


def _mean(parts: Sequence[Sampled], shares: Array | None = None) -> Sampled:
    """Mean marginals of several, which count alike or by shares; their states, the best first."""
    levels = zip(*(part.marginals for part in parts), strict=True)
    states = sorted((s for p in parts for s in p.states), key=lambda state: -state[0])
    return Sampled(
        tuple(np.average(level, axis=0, weights=shares) for level in levels),
        parts[0].gross,
        tuple(states),
        np.average([part.sensitive for part in parts], axis=0, weights=shares),
    )


def _thinned(problem: JointProblem, state: Sequence[SelectedTerm]) -> Sequence[SelectedTerm]:
    """Without terms that these rows do not show, the weaker half of them at a time.

    What all rows of a long recording show some of them may not; what is missed is added again.
    """
    while True:
        reduced, slots = problem.reduce(state), problem.slots(state)
        own = {t.index: problem.own_evidence(reduced, t) for t in slots}
        slot = log_slot(max(len(slots) - 1, 0))
        weak = sorted((i for i in own if own[i] + slot <= 0.0), key=own.__getitem__)
        if not weak:
            return state
        state = [t for t in state if t.index not in weak[: (len(weak) + 1) // 2]]


def _marginals(
    problem: JointProblem, asked: Sequence[Array], held: Mapping[int, float]
) -> tuple[Array, ...]:
    """Probability of every label, level by level, that any slot holds it.

    Args:
        problem: What was asked.
        asked: Log odds of every term in each slot (K, C).
        held: Terms of the state, with their widths.
    """
    shares = np.stack([shares_of(log_odds) for log_odds in asked])
    found = [_any(_summed(shares, *of)) for of in zip(problem.labels, problem.sizes, strict=True)]
    if problem.unlisted is None or problem.shared is None:
        return tuple(found)
    lacked = _summed(np.where(problem.unlisted, shares, 0.0), problem.labels[0], problem.sizes[0])
    own = 1.0 - _parts(problem, problem.shared, lacked, held)
    alone = _any(own * _summed(shares, problem.labels[0], problem.sizes[0]))
    found[0] = np.where(problem.listed, alone, found[0])
    return tuple(found)


def _parts(problem: JointProblem, shared: Parts, lacked: Array, held: Mapping[int, float]) -> Array:
    """Probability (K, L) that a label in a slot is a part of what is unlisted in the others (K, L).

    What the state has told of its own labels, given what other places have, stays so.
    """
    labels, size = problem.labels[0], problem.sizes[0]
    at = np.zeros(size, dtype=np.intp)
    at[labels] = problem.labels[1]

    def conditional(related: NDArray[np.bool_]) -> Array:
        return _elsewhere(np.minimum(lacked @ related.T, 1.0))

    same, one, every = (conditional(shared.apart <= k) for k in range(3))
    found = same + shared.prior * (one - same) + shared.prior**2 * (every - one)
    there = same + shared.prior * (conditional(at[:, None] == at) - same)
    told, parts = np.zeros(size), replace(problem, widths=held).parts(held)
    told[list(parts)] = list(parts.values())
    own = np.isin(np.arange(size), labels[list(held)])
    return np.where(own, np.maximum(told * every, there), found)


def _elsewhere(shares: Array) -> Array:
    """Probability (K, ...) that any other slot than each holds it, by what each does (K, ...)."""
    none = np.log1p(-np.minimum(shares, 1.0 - 1e-12))
    return np.asarray(1.0 - np.exp(none.sum(axis=0) - none))


def _summed(shares: Array, level: NDArray[np.intp], size: int) -> Array:
    """Shares (K, C) of every label of a level (K, size)."""
    return np.stack([np.minimum(np.bincount(level, row, size), 1.0) for row in shares])


def _any(shares: Array) -> Array:
    """Probability (size,) that any of the slots holds it, by what each does (K, size)."""
    return np.asarray(1.0 - np.prod(1.0 - shares, axis=0))

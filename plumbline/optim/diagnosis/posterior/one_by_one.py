r"""Of many causes: the best state near by, a chain of states from there, and what each term is.

A state too long for chains is climbed: what the state lacks is added, and then slot after slot is
asked what fills it, given all others,

.. math:: p(c \mid M \setminus e) = \frac{w_c B_c}{1 + \sum_d w_d B_d},

and kept, filled otherwise or emptied, until nothing changes (iterated conditional modes, Besag
1986, J. R. Stat. Soc. B 48(3)). What the library lacks goes in first: a slot that is asked while
something else is missing is asked for both. One term goes at a time, so that of two that stand in
for each other one stays. A climb ends in one of many states that say nearly the same and is sure of
it; a chain draws from these shares instead (Geman and Geman 1984, IEEE TPAMI 6(6)).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.joint import LEAST_HEARD, Sampled, shares_of
from plumbline.optim.diagnosis.posterior.joint_problem import JointProblem, log_slot, stated
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm
from plumbline.optim.diagnosis.posterior.slots import climbed, extended
from plumbline.optim.diagnosis.prior import BETWEEN, LONG_MOVES, ROUNDS, TILT

Known = dict[frozenset[SelectedTerm], tuple[Array, Array]]  # what has been asked of states


def best_near(problem: JointProblem, state: Sequence[SelectedTerm]) -> tuple[SelectedTerm, ...]:
    """The best state near a long one. Rows that this takes for gross stay so."""
    return tuple(climbed(problem, extended(problem, _thinned(problem, state)), ROUNDS))


def coarsened(
    problem: JointProblem, state: Sequence[SelectedTerm], power: float, seed: int
) -> Sampled:
    """Sampled by a power of the likelihood, a share of what the rows say, by two chains.

    They start at the best of three climbs' ends, and at another if it is as good but for chance:
    from the state downwards, from its listed terms, whose places nothing else then holds, and from
    its gross rows upwards.
    """
    whole = problem.linear
    linear = Linear(power * whole.G, power * whole.b, power * whole.tt, power * whole.n)
    problem = replace(problem, linear=linear)
    gross = [t for t in state if problem.gross[t.index]]
    none = problem.unlisted
    listed = state if none is None else [t for t in state if not none[t.index]]
    ends = [best_near(problem, start) for start in (state, listed, gross)]
    logs = np.array([stated(problem, end) for end in ends])
    near = [ends[k] for k in np.argsort(-logs) if logs[k] > logs.max() + LEAST_HEARD]
    known = Known()
    chains = [
        _mean(list(_chain(problem, end, np.random.default_rng([seed, k]), known)))
        for k, end in enumerate((near[0], near[-1]))
    ]
    # Chains that do not cross count by the best that each has found.
    found = np.array([chain.states[0][0] for chain in chains])
    apart = np.ptp([chain.marginals[0] for chain in chains], axis=0)
    return replace(_mean(chains, np.exp(found - found.max())), apart=float(apart.max(initial=0.0)))


def _asked(
    problem: JointProblem, reduced: Reduced, gone: Sequence[SelectedTerm], known: Known
) -> tuple[Array, Array]:
    """Log odds and scales (C,) of what fills a state without one term; no state is asked twice."""
    key = frozenset(t for t in reduced.chosen if t not in gone)
    if key not in known:
        log_odds, scores = problem.odds(reduced.without(gone[0]) if gone else reduced)
        known[key] = log_odds, scores.scale
    return known[key]


def _chain(
    problem: JointProblem,
    state: Sequence[SelectedTerm],
    rng: np.random.Generator,
    known: Known,
) -> Iterator[Sampled]:
    """Probabilities about states of a chain that asks one place anew at a time, given all others.

    Of n + 1 places the last is empty; what it draws is accepted with probability
    (n + 1) / (n + 2), which makes the chain reversible (Hastings 1970).
    """
    reduced = problem.reduce(state)
    for move in range(LONG_MOVES):
        if move % BETWEEN == 0:
            yield _about(problem, reduced, known)
        slots = problem.slots(reduced.chosen)
        place = int(rng.integers(len(slots) + 1))
        old = slots[place : place + 1]
        log_odds, scale = _asked(problem, reduced, old, known)
        drawn = int(np.searchsorted(np.cumsum(shares_of(log_odds)), rng.random()))
        new = [SelectedTerm(k, float(scale[k])) for k in range(len(log_odds))[drawn:][:1]]
        if old != new and (old or rng.random() < 1.0 - 1.0 / (len(slots) + 2)):
            reduced = problem.reduce([*(t for t in reduced.chosen if t not in old), *new])


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


def _about(problem: JointProblem, reduced: Reduced, known: Known) -> Sampled:
    """Probabilities about a state: each of its terms given all others, and one more."""
    slots = problem.slots(reduced.chosen)
    asked = [_asked(problem, reduced, gone, known)[0] for gone in ([], *([t] for t in slots))]
    tilts = (0.0, -float(np.log(TILT)), float(np.log(TILT)))
    held = [t.index for t in slots]
    found, *tilted = (_marginals(problem, [log + tilt for log in asked], held) for tilt in tilts)
    gross = np.zeros(len(problem.candidates))
    gross[[t.index for t in reduced.chosen if problem.gross[t.index]]] = 1.0
    states = ((stated(problem, reduced.chosen), reduced.chosen),)
    return Sampled(found, gross, states, np.stack([levels[0] for levels in tilted]))


def _marginals(
    problem: JointProblem, asked: Sequence[Array], held: Sequence[int]
) -> tuple[Array, ...]:
    """Probability of every label, level by level, that any slot holds it.

    Args:
        problem: What was asked.
        asked: Log odds of every term in each slot.
        held: Terms of the state.
    """
    shares = np.stack([shares_of(log_odds) for log_odds in asked])
    found = [_any(_summed(shares, *of)) for of in zip(problem.labels, problem.sizes, strict=True)]
    if problem.unlisted is None or problem.shared is None:
        return tuple(found)
    # What a listed label holds beside an unlisted term may be a part of that: one of its place, and
    # any that the state does not show to be far larger.
    lacked = np.where(problem.unlisted, shares, 0.0)
    place = problem.labels[1]
    own = _elsewhere(_summed(lacked, place, problem.sizes[1]))[:, place]
    all_ = _elsewhere(lacked.sum(axis=1, keepdims=True))
    part = np.full(problem.sizes[0], problem.shared.prior)
    parts = problem.parts(held)
    part[list(parts)] = list(parts.values())
    large = set(problem.labels[0][list(held)].tolist()) - set(parts)
    far_larger = np.isin(problem.labels[0], list(large))
    apart = shares * (1.0 - np.where(far_larger, own, all_))
    alone = _any(_summed(apart, problem.labels[0], problem.sizes[0]))
    found[0] = np.where(problem.listed, (1.0 - part) * found[0] + part * alone, found[0])
    return tuple(found)


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

r"""Of many causes: the best state near by, and what each of its terms is, given all others.

A state too long for chains is climbed: what the state lacks is added, and then slot after slot is
asked what fills it, given all others,

.. math:: p(c \mid M \setminus e) = \frac{w_c B_c}{1 + \sum_d w_d B_d},

and kept, filled otherwise or emptied, until nothing changes (iterated conditional modes, Besag
1986, J. R. Stat. Soc. B 48(3)). What the library lacks goes in first: a slot that is asked while
something else is missing is asked for both. One term goes at a time, so that of two that stand in
for each other one stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.joint import Sampled, shares_of
from plumbline.optim.diagnosis.posterior.joint_problem import JointProblem, log_slot, stated
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm
from plumbline.optim.diagnosis.posterior.slots import climbed, extended
from plumbline.optim.diagnosis.prior import ROUNDS, TILT


def one_by_one(problem: JointProblem, state: Sequence[SelectedTerm]) -> Sampled:
    """The best state near a long one, and probabilities about it.

    What several terms of a label say is that any of them is there. Rows that the state takes for
    gross stay so.
    """
    found = climbed(problem, extended(problem, _thinned(problem, state)), ROUNDS)
    return _about(problem, problem.reduce(found))


def coarsened(problem: JointProblem, state: Sequence[SelectedTerm], power: float) -> Sampled:
    """The same by a power of the likelihood, a share of what the rows say, from three starts.

    From the state downwards, from its listed terms, whose places nothing else then holds, and from
    its gross rows upwards: a climb ends where one step more does not gain, and what a few terms say
    of such data may be another state than what is left of many. All ends count by their posterior.
    """
    whole = problem.linear
    linear = Linear(power * whole.G, power * whole.b, power * whole.tt, power * whole.n)
    problem = replace(problem, linear=linear)
    gross = [t for t in state if problem.gross[t.index]]
    none = problem.unlisted
    listed = state if none is None else [t for t in state if not none[t.index]]
    return _mixed([one_by_one(problem, start) for start in (state, listed, gross)])


def _mixed(ends: Sequence[Sampled]) -> Sampled:
    """Marginals of several states, each by its posterior; the same state counts once."""
    each = {frozenset(t.index for t in e.states[0][1]): e for e in ends}
    found = sorted(each.values(), key=lambda e: -e.states[0][0])
    shares = np.exp([e.states[0][0] - found[0].states[0][0] for e in found])
    shares /= shares.sum()
    levels = zip(*(e.marginals for e in found), strict=True)
    marginals = tuple(np.tensordot(shares, np.stack(level), 1) for level in levels)
    sensitive = np.tensordot(shares, np.stack([e.sensitive for e in found]), 1)
    states = tuple(state for e in found for state in e.states)
    return Sampled(marginals, found[0].gross, states, sensitive)


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


def _about(problem: JointProblem, reduced: Reduced) -> Sampled:
    """Probabilities about a state: each of its terms given all others, and one more."""
    slots = problem.slots(reduced.chosen)
    asked = [problem.odds(reduced)[0], *(problem.odds(reduced.without(t))[0] for t in slots)]
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

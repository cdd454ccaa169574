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
from scipy.special import logsumexp

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import block_evidence
from plumbline.optim.diagnosis.posterior.joint import Sampled, shares_of
from plumbline.optim.diagnosis.posterior.joint_problem import JointProblem
from plumbline.optim.diagnosis.posterior.reduction import Reduced, SelectedTerm
from plumbline.optim.diagnosis.prior import (
    ASKED_AGAIN,
    LOG_SCALE_WEIGHTS,
    MOST_ADDED,
    NEXT_SLOT_ODDS,
    NO_EVIDENCE,
    TILT,
)

LOG_NEXT = float(np.log(NEXT_SLOT_ODDS))


def one_by_one(problem: JointProblem, state: Sequence[SelectedTerm]) -> Sampled:
    """The best state near a long one, and probabilities about it.

    What several terms of a label say is that any of them is there. Rows that the state takes for
    gross stay so.
    """
    reduced = _given(problem, state, problem.variance(problem.reduce([], 1.0)))
    reduced = _thinned(problem, reduced)
    for _ in range(ASKED_AGAIN):
        before = {t.index for t in reduced.chosen}
        reduced = _asked_again(problem, _extended(problem, reduced))
        if {t.index for t in reduced.chosen} == before:
            break
    return _about(problem, reduced)


def added_evidence(
    problem: JointProblem, state: Sequence[SelectedTerm], more: Sequence[SelectedTerm]
) -> float:
    """Log odds of a state with some terms more against the one without, term by term."""
    total, reduced = 0.0, _given(problem, state, problem.variance(problem.reduce([], 1.0)))
    for term in more:
        total += float(problem.odds(reduced)[0][term.index])
        reduced = _given(problem, [*reduced.chosen, term], problem.variance(reduced))
    return total


def coarsened(problem: JointProblem, state: Sequence[SelectedTerm], power: float) -> Sampled:
    """The same from a state on by a power of the likelihood: a share of what the rows say."""
    whole = problem.linear
    linear = Linear(power * whole.G, power * whole.b, power * whole.tt, power * whole.n)
    return one_by_one(replace(problem, linear=linear), state)


def _given(problem: JointProblem, state: Sequence[SelectedTerm], variance: float) -> Reduced:
    """What a state leaves, at the noise that it leaves; from a guess of it."""
    return problem.reduce(state, problem.settled(state, variance))


def _thinned(problem: JointProblem, reduced: Reduced) -> Reduced:
    """Without terms that these rows do not show, the weaker half of them at a time.

    What all rows of a long recording show some of them may not; what is missed is added again.
    """
    while True:
        mine = [t for t in reduced.chosen if not problem.gross[t.index]]
        own = {t.index: _own_evidence(problem, reduced, t) for t in mine}
        weak = sorted((i for i in own if own[i] + LOG_NEXT <= 0.0), key=own.__getitem__)
        if not weak:
            return reduced
        rest = [t for t in reduced.chosen if t.index not in weak[: (len(weak) + 1) // 2]]
        reduced = _given(problem, rest, problem.variance(reduced))


def _extended(problem: JointProblem, reduced: Reduced) -> Reduced:
    """With what the state lacks, until nothing more is as probable as not."""
    for _ in range(MOST_ADDED):
        log_odds, scores = problem.odds(reduced)
        if logsumexp(log_odds) <= 0.0:
            break
        best = _best(problem, log_odds)
        more = SelectedTerm(best, float(scores.scale[best]))
        reduced = _given(problem, [*reduced.chosen, more], problem.variance(reduced))
    return reduced


def _asked_again(problem: JointProblem, reduced: Reduced) -> Reduced:
    """One pass over the slots, the weakest first."""
    mine = [t for t in reduced.chosen if not problem.gross[t.index]]
    for term in sorted(mine, key=lambda t: _own_evidence(problem, reduced, t)):
        log_odds, scores = problem.odds(reduced.without(term))
        rest = [t for t in reduced.chosen if t.index != term.index]
        best = _best(problem, log_odds)
        if logsumexp(log_odds) > 0.0:
            alike = problem.labels[0][best] == problem.labels[0][term.index]
            if log_odds[best] <= log_odds[term.index] + (NO_EVIDENCE if alike else 0.0):
                continue
            rest.append(SelectedTerm(best, float(scores.scale[best])))
        reduced = _given(problem, rest, problem.variance(reduced))
    return reduced


def _own_evidence(problem: JointProblem, reduced: Reduced, term: SelectedTerm) -> float:
    """Log odds of a state's term given all others; what all of them bear alike left out."""
    block, b, tt, n = reduced.of(term)
    sides = np.array([problem.terms[term.index].sides])
    by_scale = block_evidence(block[None], b[None], tt, n, problem.noise, sides)
    log_bayes = float(logsumexp(by_scale + LOG_SCALE_WEIGHTS))
    return log_bayes + float(problem.log_priors[term.index])


def _best(problem: JointProblem, log_odds: Array) -> int:
    """The best term of the label that is the most probable, all its terms together."""
    mechanism = problem.labels[0]
    total = np.full(problem.sizes[0], -np.inf)
    np.logaddexp.at(total, mechanism, log_odds)
    return int(np.argmax(np.where(mechanism == np.argmax(total), log_odds, -np.inf)))


def _about(problem: JointProblem, reduced: Reduced) -> Sampled:
    """Probabilities about a state: each of its terms given all others, and one more."""
    slots = [t for t in reduced.chosen if not problem.gross[t.index]]
    asked = [problem.odds(reduced)[0], *(problem.odds(reduced.without(t))[0] for t in slots)]
    tilts = (0.0, -float(np.log(TILT)), float(np.log(TILT)))
    found, *tilted = (_marginals(problem, [log + tilt for log in asked]) for tilt in tilts)
    gross = np.zeros(len(problem.terms))
    gross[[t.index for t in reduced.chosen if problem.gross[t.index]]] = 1.0
    states = ((0.0, reduced.chosen),)
    return Sampled(found, gross, states, np.stack([levels[0] for levels in tilted]))


def _marginals(problem: JointProblem, asked: Sequence[Array]) -> tuple[Array, ...]:
    """Probability of every label, level by level, that any slot holds it."""
    absent = [np.ones(size) for size in problem.sizes]
    for log_odds in asked:
        shares = shares_of(log_odds)
        for level, left in zip(problem.labels, absent, strict=True):
            left *= 1.0 - np.minimum(np.bincount(level, shares, len(left)), 1.0)
    return tuple(1.0 - left for left in absent)

r"""Whether fewer terms do as well where rows know of each other.

With enough terms that suit them, what the readings of one posture share is a model's, not theirs:
of twenty postures three gears' spectra hold all that noise shares. So each state M is weighed with
the correlation R that what it leaves asks for,

.. math:: \log p(t \mid M) + \log \frac{p(e_M \mid R)}{p(e_M \mid I)} + \log p(M),

the best one, what is left as its least probable terms go, and what comes to none term by term.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import isqrt
from operator import itemgetter

import numpy as np

from plumbline.optim.diagnosis.posterior.correlation import RowNoise
from plumbline.optim.diagnosis.posterior.joint_problem import JointProblem, stated
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.prior import MANY_CAUSES, PAIRED

Terms = Sequence[SelectedTerm]
Told = tuple[RowNoise, float]  # what some terms leave asks for, and its log odds
Asked = Callable[[Terms], Told | None]  # none where that cannot be told


def most_probable(
    problem: JointProblem, states: Sequence[Terms], asked: Asked, more: int = MANY_CAUSES
) -> RowNoise:
    """The correlation of the most probable of some states, and of up to so many terms more."""

    def weighed(terms: Terms) -> tuple[float, RowNoise, Terms]:
        correlation, odds = asked(terms) or (RowNoise(), -np.inf)
        return odds + stated(problem, terms), correlation, terms

    back = [weighed(terms) for terms in states]
    climb = [back[-1]]
    for _ in range(more):
        near = [weighed(terms) for terms in one_more(problem, climb[-1][2])]
        climb.append(max(near, key=itemgetter(0), default=climb[-1]))
        if climb[-1][0] <= climb[-2][0]:
            break
    return max([*back, *climb], key=itemgetter(0))[1]


def taken_back(problem: JointProblem, state: Terms) -> Iterator[Terms]:
    """A state, and what is left as the least probable of its terms go, to none that fills a slot.

    Rows that are gross stay. Of many terms some go at once (cost only).
    """
    left = state
    while slots := problem.slots(left):
        yield left
        own = problem.only([t.index for t in left])
        reduced = own.reduce([replace(t, index=k) for k, t in enumerate(left)])
        numbers = [left.index(t) for t in slots]
        worth = {k: own.own_evidence(reduced, reduced.chosen[k]) for k in numbers}
        gone = sorted(numbers, key=worth.__getitem__)[: isqrt(len(slots)) // 2 or 1]
        left = [t for k, t in enumerate(left) if k not in gone]
    yield left


def one_more(problem: JointProblem, terms: Terms) -> Iterator[Terms]:
    """Some terms with one of the most probable beside them, the best form of each mechanism."""
    log_odds, scores = problem.odds(problem.reduce(terms))
    ranked = np.argsort(-log_odds, kind="stable")
    first = np.sort(np.unique(problem.causes[ranked], return_index=True)[1])
    for i in ranked[first[:PAIRED]].tolist():
        yield [*terms, SelectedTerm(i, float(scores.scale[i]))]

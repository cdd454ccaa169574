r"""Which listed terms beside an unlisted mechanism may be parts of it, and how probably.

What nobody has listed need not be one term of ours: other columns take up what its own leave. A
listed term k is such a part with a stated probability :math:`\pi` beforehand. Whatever a mechanism
at a place does, it moves row n only along what that place can move, :math:`D_n`. So what speaks
for the term in the rest of the rows, :math:`(I - D_n D_n^+) t_n`, speaks against its being a part,

.. math:: P(\text{part}) = \frac{\pi}{\pi + (1 - \pi) B_k}, \qquad
          B_k = \frac{p(\text{rest} \mid k \text{ and the other listed terms})}
                     {p(\text{rest} \mid \text{the others})}.

Where the place can move all there is, nothing is left to tell, and B = 1; nor is B less: a rest
that says nothing for the term leaves what all of the rows say. The same holds of a term that what
drives several joints may drive too: a mechanism of them all has no such place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior, Term
from plumbline.optim.diagnosis.prior import DEVIATIONS

State = frozenset[int]
Evidence = Callable[[State], float]  # log of it, of some terms


class Problem(Protocol):
    """What is asked of a joint problem."""

    @property
    def linear(self) -> Linear:
        """The problem with the nuisances eliminated."""

    @property
    def candidates(self) -> Sequence[Term]:
        """All terms that there may be (C)."""

    @property
    def gross(self) -> NDArray[np.bool_]:
        """Which terms are single rows that may be gross (C,)."""

    @property
    def labels(self) -> NDArray[np.intp]:
        """Level by level, what each term belongs to (L, C)."""

    @property
    def noise(self) -> NoisePrior:
        """The prior of the noise."""

    @property
    def unlisted(self) -> NDArray[np.bool_] | None:
        """Which terms are of no effect of the library (C,), if any."""

    def beside(self, indices: Sequence[int], linear: Linear) -> Evidence:
        """What tells the evidence of some of these terms beside the others, in another problem."""


@dataclass(frozen=True, eq=False)
class Parts:
    """What tells parts of an unlisted mechanism from causes of their own.

    Attributes:
        prior: Probability that a listed term is a part, where it may be.
        beyond: The listed terms' problem in what no mechanism at some places could move.
        drivers: Of each label of the first level, what drives it that joints share.
    """

    prior: float
    beyond: Callable[[State], Linear] | None = None
    drivers: tuple[frozenset[str], ...] = ()
    _found: dict[State, Mapping[int, float]] = field(default_factory=dict)
    _rest: dict[State, Linear] = field(default_factory=dict)
    _logs: dict[tuple[State, State], Evidence] = field(default_factory=dict)

    def of(self, problem: Problem, indices: Iterable[int]) -> Mapping[int, float]:
        """Labels of some terms, of the first level, that may be parts, with the probability."""
        key = frozenset(i for i in indices if not problem.gross[i])
        if key not in self._found:
            self._found[key] = self._of(problem, sorted(key))
        return self._found[key]

    def _of(self, problem: Problem, indices: list[int]) -> Mapping[int, float]:
        if problem.unlisted is None or not problem.unlisted[indices].any():
            return {}
        lacked = [i for i in indices if problem.unlisted[i]]
        listed = frozenset(indices).difference(lacked)
        return {
            k: self._part(problem, k, listed, lacked) for k in _may_be(problem, indices, lacked)
        }

    def _part(self, problem: Problem, k: int, listed: State, lacked: Sequence[int]) -> float:
        """Probability that a label of the listed terms is a part."""
        label, place = problem.labels[:2]
        places = frozenset(place[lacked].tolist())
        own = frozenset(i for i in listed if label[i] == k)
        told = self.beyond is not None and places.isdisjoint(place[list(own)].tolist())
        if not told or any(self.drivers[k] & self.drivers[label[i]] for i in lacked):
            return self.prior
        log = self._beside(problem, listed, places)(own)
        return float(expit(logit(self.prior) - max(log, 0.0)))

    def _beside(self, problem: Problem, listed: State, places: State) -> Evidence:
        """Of listed terms, by what no mechanism at some places could move."""
        assert self.beyond is not None
        if places not in self._rest:
            self._rest[places] = self.beyond(places)
        if (listed, places) not in self._logs:
            self._logs[listed, places] = problem.beside(sorted(listed), self._rest[places])
        return self._logs[listed, places]


def _may_be(problem: Problem, indices: Sequence[int], lacked: Sequence[int]) -> set[int]:
    """Labels of listed terms that may be parts of what is lacked beside them.

    Those at a place of it, and those that move so little that all of it may be how what is at work
    deviates from them.
    """
    label, place = problem.labels[:2]
    places = set(place[lacked].tolist())
    mine = {int(label[i]): int(place[i]) for i in indices if i not in lacked}
    found = {k for k in mine if mine[k] in places}
    if len(found) == len(mine):
        return found
    moved = moved_by(problem, indices)
    whole = moved(lacked)
    each = {k: moved([i for i in indices if label[i] == k]) for k in mine}
    return found | {k for k in mine if DEVIATIONS[0] ** 2 * each[k] <= whole}


def moved_by(problem: Problem, indices: Sequence[int]) -> Callable[[Sequence[int]], float]:
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

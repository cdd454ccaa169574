r"""Moments at which a joint's error jumps, found one by one: it winds up, sticks and lets go.

Between two jumps the error of a joint that sticks follows its angle,

.. math:: e_n = w\,q_n + \sum_{k \in S} c_k\, [n > k],

a piecewise function whose moments S are unknown (stick-slip: Armstrong-Helouvry, Dupont and Canudas
de Wit 1994, Automatica 30(7)). They are found by orthogonal matching pursuit (Pati, Rezaiifar and
Krishnaprasad 1993): the moment whose step explains most given those already found, as long as all
are worth their price, of which :func:`log_share` is a part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.linear import orthonormal
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.prior import GROSS_ODDS, JUMP_PRICE, MOST_JUMPS, PATIENCE

DEPENDENT = 1e-6  # share of a column below which the others make it up
LOG_GROSS = np.log(GROSS_ODDS)


@dataclass(frozen=True)
class Jumps:
    """Which steps and which gross rows explain a reading best at their price."""

    steps: list[int]  # numbers of the steps
    rows: list[int]  # numbers of the gross rows
    log_share: float  # log prior probability of these among all sets of steps and rows


def find_jumps(
    always: Array, steps: Array, rows: Array, target: Array, nuisances: Array, noise: NoisePrior
) -> Jumps:
    """Which steps, and which rows as gross ones, are worth their price together.

    Steps are looked for given the gross rows and before them, as a row between two jumps looks
    like a gross one until both are there; what is then dispensable goes.

    Args:
        always: Columns that are fitted with any steps (K, E).
        steps: Columns of one step at every moment (S, E).
        rows: Columns that shift each of the rows that may be gross (R, m, E).
        target: What is to be explained (E,).
        nuisances: Columns of what is always fitted (P, E).
        noise: The prior of the noise.
    """
    basis = orthonormal(nuisances.T)
    left = target - basis @ (basis.T @ target)
    columns = np.concatenate([always, steps, rows.reshape(-1, len(target))])
    columns = columns - (columns @ basis) @ basis.T
    K, S, m = len(always), len(steps), rows.shape[1]
    groups = [np.array([K + k]) for k in range(S)]
    groups += [K + S + m * k + np.arange(m) for k in range(len(rows))]
    G, b = columns @ columns.T, columns @ left
    pursuit = _Pursuit(G, b, float(left @ left), len(left), K, S, groups, noise)
    starts: list[list[int]] = [[], *([pursuit.on([], S).taken] if len(rows) else [])]
    found = [pursuit.pruned(pursuit.on(start, len(groups))) for start in starts]
    best = max(found, key=lambda f: f.worth).taken
    chosen = [g for g in best if g < S], [g - S for g in best if g >= S]
    return Jumps(*chosen, pursuit.log_share(best))


@dataclass(frozen=True, eq=False)
class _Pursuit:
    """Groups of columns that compete for a target."""

    G: Array  # gram matrix of all columns
    b: Array  # their products with the target
    square: float  # the target's square
    n: int  # its length
    always: int  # how many columns are fitted with any group
    steps: int  # how many groups are steps; those after them are gross rows
    groups: Sequence[NDArray[np.intp]]  # columns of every group
    noise: NoisePrior  # the prior of the noise

    def columns(self, taken: Sequence[int]) -> NDArray[np.intp]:
        """Those of some groups, behind what is always fitted."""
        return np.concatenate([np.arange(self.always), *(self.groups[g] for g in taken)])

    def log_share(self, taken: Sequence[int]) -> float:
        """Log prior probability of some groups."""
        jumps = sum(g < self.steps for g in taken)
        return log_share(jumps, self.steps) + LOG_GROSS * (len(taken) - jumps)

    def fitted(self, taken: Sequence[int]) -> _Fitted:
        """All columns of some groups."""
        mine = self.columns(taken)
        block = self.G[np.ix_(mine, mine)]
        size = np.maximum(np.diag(block), DEPENDENT * float(np.diag(self.G).max()))
        inverse = np.asarray(np.linalg.inv(block + DEPENDENT * np.diag(size)), dtype=float)
        weights = inverse @ self.b[mine]
        left = max(self.square - float(self.b[mine] @ weights), 0.0)
        variance = float(self.noise.variance(left, self.n))
        fit = -0.5 * (self.noise.freedom + self.n) * np.log(variance)
        worth = float(fit + self.log_share(taken) - JUMP_PRICE * len(mine))
        return _Fitted(list(taken), mine, inverse, weights, variance, worth)

    def on(self, taken: Sequence[int], allowed: int) -> _Fitted:
        """The best length of a path that goes on from some groups, among the first few."""
        best = now = self.fitted(taken)
        while len(now.taken) < min(len(best.taken) + PATIENCE, MOST_JUMPS, allowed):
            now = self.fitted([*now.taken, int(np.argmax(self._gains(now, allowed)))])
            best = max(best, now, key=lambda f: f.worth)
        return best

    def _gains(self, now: _Fitted, allowed: int) -> Array:
        """What each group would explain given those taken, less its price (allowed,)."""
        seen = self.G[now.mine]
        b = self.b - now.weights @ seen
        left = np.diag(self.G) - np.einsum("ij,ij->j", seen, now.inverse @ seen)
        known = left <= DEPENDENT * np.diag(self.G)
        each = np.where(known, 0.0, b**2 / np.maximum(left, 1e-300))
        one, many = np.split(each[self.always :], [self.steps])
        # A row's columns hardly overlap, as long as they are few among many.
        count = len(self.groups) - self.steps
        rows = many.reshape(count, many.size // max(count, 1))
        by_group = np.concatenate([one, rows.sum(axis=1)])
        price = np.full(len(by_group), np.log(self.steps) + JUMP_PRICE)
        price[self.steps :] = JUMP_PRICE * rows.shape[1] - LOG_GROSS
        gains = 0.5 * by_group / now.variance - price
        gains[now.taken] = -np.inf
        return np.asarray(gains[:allowed])

    def pruned(self, now: _Fitted) -> _Fitted:
        """Without groups that are not worth their price given the others."""
        while now.taken:
            at = self.always + np.cumsum([0, *(len(self.groups[g]) for g in now.taken)])
            losses = [_loss(now, slice(*ends)) for ends in pairwise(at)]
            fewer = [g for g in now.taken if g != now.taken[int(np.argmin(losses))]]
            without = self.fitted(fewer)
            if without.worth <= now.worth:
                break
            now = without
        return now


@dataclass(frozen=True, eq=False)
class _Fitted:
    """The fit of some groups: their columns, inverse, weights, noise variance, and worth."""

    taken: list[int]
    mine: NDArray[np.intp]
    inverse: Array
    weights: Array
    variance: float
    worth: float


def _loss(now: _Fitted, own: slice) -> float:
    """What a fit loses without some of its columns, for each of them."""
    w = now.weights[own]
    return float(w @ np.linalg.solve(now.inverse[own, own], w)) / len(w)


def log_share(jumps: int, moments: int) -> float:
    """Log prior probability of one set of this many jumps among all numbers and all sets."""
    ways = gammaln(moments + 1) - gammaln(jumps + 1) - gammaln(moments - jumps + 1)
    return float(-ways - np.log(moments))

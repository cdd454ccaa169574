"""A solution judges itself: nothing of its quality is taken from the solver."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from plumbline.optim.core.constants import NEAR
from plumbline.optim.core.mapped import Gram, Mapped
from plumbline.optim.core.problem import Array, Problem


@dataclass(frozen=True, eq=False)
class Solution:
    """A point, and how good it is by the problem's own statement."""

    problem: Problem  #: what was to be solved
    x: Array  #: the point (P,)
    iterations: int = 0  #: how many steps the solver took
    message: str = ""  #: what the solver says, in words; never used to judge
    #: of bounds (P,) and constraints (c,), where the solver has them: above 0 where an upper bound
    #: presses. They may be offered as proof, and to start from.
    multipliers: tuple[Array, Array] | None = None
    #: whether the solver says that it stopped of its own accord; never used to judge
    success: bool = True

    def __repr__(self) -> str:
        """How many unknowns, after how many steps, and what the solver said."""
        steps = f"{self.problem.size} unknowns after {self.iterations} steps"
        return f"<Solution: {steps}; {self.message[:80] or 'nothing said'}>"

    @property
    def by_name(self) -> dict[str, float]:
        """The point's values by their names."""
        return dict(zip(self.problem.names, self.x.tolist(), strict=True))

    @cached_property
    def mapped(self) -> Mapped:
        """The problem's functions."""
        return Mapped(self.problem)

    @cached_property
    def gram(self) -> Gram:
        """Normal equations at the point."""
        return self.mapped.gram(self.x)

    def judged_by(self, gram: Gram) -> Solution:
        """The same, by normal equations at the point that have been worked out already."""
        vars(self)["gram"] = gram
        return self

    @property
    def cost(self) -> float:
        """What is to be least, at the point."""
        return self.gram.square / 2 + self.mapped.objective(self.x)[0]

    @cached_property
    def gradient(self) -> Array:
        """Gradient (P,) of the cost."""
        return self.gram.vector + self.mapped.objective(self.x)[1]

    def primal_violation(self) -> float:
        """Largest violation of a bound or constraint, in the unknowns' own units."""
        p = self.problem
        gaps = [p.lower - self.x, self.x - p.upper]
        if p.constraints.numel():
            g = self.mapped.constraints(self.x)
            gaps += [p.g_lower - g, g - p.g_upper]
        return float(max(0.0, np.concatenate(gaps).max(initial=0.0)))

    def stationarity(self) -> float:
        """Largest drop of cost, relative to it, that a step along one unknown alone promises.

        The step is that of Gauss and Newton, cut at the unknown's bounds: pushing against a bound
        counts for nothing. Active constraints hold against the gradient as well as they can.
        """
        p = self.problem
        gradient = (self.gradient - self.held_by_constraints()) * p.scale
        curvature = np.diag(self.gram.matrix + self.mapped.bend(self.x)) * p.scale**2
        floor = max(1e-12 * curvature.max(initial=0.0), np.finfo(float).tiny)
        curvature = np.maximum(curvature, floor)
        back, ahead = np.minimum(p.lower - self.x, 0.0), np.maximum(p.upper - self.x, 0.0)
        step = np.clip(-gradient / curvature, back / p.scale, ahead / p.scale)
        drop = -step * (gradient + curvature * step / 2)
        return float(drop.max(initial=0.0) / max(abs(self.cost), np.finfo(float).tiny))

    def held_by_constraints(self) -> Array:
        """The part (P,) of the gradient that active constraints balance; they only push."""
        p = self.problem
        if not p.constraints.numel():
            return np.zeros(p.size)
        g, A = self.mapped.constraints(self.x), self.mapped.slopes(self.x)
        near = NEAR * (1 + np.abs(g))
        low, high = g - p.g_lower <= near, p.g_upper - g <= near
        pushes = np.concatenate([A[low], -A[high]])
        free = ~self._resting()
        if not len(pushes) or not free.any():
            return np.zeros(p.size)
        sizes = p.scale[free]
        strength, _ = scipy.optimize.nnls((pushes[:, free] * sizes).T, self.gradient[free] * sizes)
        return pushes.T @ strength

    def _resting(self) -> NDArray[np.bool_]:
        """Which unknowns (P,) are within a millionth of their scale of a bound."""
        p = self.problem
        room = NEAR * p.scale
        return (self.x <= p.lower + room) | (self.x >= p.upper - room)

    def is_optimal(self, eps: float = 1e-8) -> bool:
        """Whether both residuals of optimality, recomputed here, are below eps."""
        return self.primal_violation() <= eps and self.stationarity() <= eps

    def at_bound(self) -> tuple[str, ...]:
        """Names of the unknowns that rest on a bound."""
        names = zip(self.problem.names, self._resting(), strict=True)
        return tuple(name for name, resting in names if resting)

    def std(self, sigma: float) -> Array:
        """Standard errors (P,) at a noise of sigma [the residual's unit]; inf if unobservable."""
        return standard_errors(self.gram.matrix, sigma)


def standard_errors(matrix: Array, sigma: float) -> Array:
    """Standard errors (P,) that normal equations (P, P) give at a noise of sigma; may be inf."""
    diagonal = np.diag(matrix)
    S = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(matrix * np.outer(S, S))
    small = values <= 1e-13 * max(len(S), 1)
    inverse = np.where(small, 0.0, 1 / np.where(small, 1.0, values))
    variance = (vectors**2) @ inverse
    lost = (vectors[:, small] ** 2).sum(axis=1) > 1e-6
    return np.where(lost, np.inf, sigma * S * np.sqrt(variance))

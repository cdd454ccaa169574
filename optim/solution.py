"""A solution judges itself: nothing of its quality is taken from the solver."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from optim.mapped import Gram, Mapped
from optim.problem import Array, Problem


@dataclass(frozen=True, eq=False)
class Solution:
    """A point, and how good it is by the problem's own statement.

    Attributes:
        problem: What was to be solved.
        x: The point (P,).
        iterations: How many steps the solver took.
        message: What the solver says, in words; never used to judge.
    """

    problem: Problem
    x: Array
    iterations: int = 0
    message: str = ""

    @cached_property
    def mapped(self) -> Mapped:
        """The problem's functions."""
        return Mapped(self.problem)

    @cached_property
    def gram(self) -> Gram:
        """Normal equations at the point."""
        return self.mapped.gram(self.x)

    @property
    def cost(self) -> float:
        """The objective at the point."""
        return self.gram.square / 2

    def primal_violation(self) -> float:
        """Largest violation of a bound or constraint, in the unknowns' own units."""
        p = self.problem
        gaps = [p.lower - self.x, self.x - p.upper]
        if p.constraints.numel():
            g = cs.Function("g", [p.x], [p.constraints])(self.x).full().ravel()
            gaps += [p.g_lower - g, g - p.g_upper]
        return float(max(0.0, np.concatenate(gaps).max(initial=0.0)))

    def stationarity(self) -> float:
        """Largest drop of cost, relative to it, that one scaled gradient component promises.

        The gradient is projected: pushing against an active bound counts for nothing.
        """
        p = self.problem
        gradient = self.gram.vector * p.scale
        at_lower, at_upper = self.x <= p.lower, self.x >= p.upper
        gradient = np.where(at_lower, np.minimum(gradient, 0), gradient)
        gradient = np.where(at_upper, np.maximum(gradient, 0), gradient)
        curvature = np.diag(self.gram.matrix) * p.scale**2
        drop = gradient**2 / np.maximum(2 * curvature, np.finfo(float).tiny)
        return float(drop.max(initial=0.0) / max(self.cost, np.finfo(float).tiny))

    def is_optimal(self, eps: float = 1e-8) -> bool:
        """Whether both residuals of optimality, recomputed here, are below eps."""
        return self.primal_violation() <= eps and self.stationarity() <= eps

    def at_bound(self) -> tuple[str, ...]:
        """Names of the unknowns that rest on a bound."""
        p = self.problem
        stuck = (self.x <= p.lower) | (self.x >= p.upper)
        return tuple(name for name, s in zip(p.names, stuck, strict=True) if s)

    def std(self, sigma: float) -> Array:
        """Standard errors (P,) at a noise of sigma [the residual's unit]; inf if unobservable."""
        diagonal = np.diag(self.gram.matrix)
        S = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        values, vectors = np.linalg.eigh(self.gram.matrix * np.outer(S, S))
        small = values <= 1e-13 * max(len(S), 1)
        inverse = np.where(small, 0.0, 1 / np.where(small, 1.0, values))
        variance = (vectors**2) @ inverse
        lost = (vectors[:, small] ** 2).sum(axis=1) > 1e-6
        return np.where(lost, np.inf, sigma * S * np.sqrt(variance))

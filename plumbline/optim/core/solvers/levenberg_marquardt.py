r"""Levenberg-Marquardt on Gram matrices (Madsen, Nielsen, Tingleff 2004, algorithm 3.16).

.. math:: (J^T J + \mu D)\, \delta = -J^T r, \qquad D = \mathrm{diag}(J^T J)

Bounds are kept by projection: unknowns that a step would push out of a bound leave the step.
Memory does not grow with the rows.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from plumbline.optim.core.mapped import Gram, Mapped
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers.solver import OfRows, refuse


@dataclass(frozen=True)
class LevenbergMarquardt(OfRows):
    """Options of the solver."""

    max_iterations: int = 60  #: steps tried at most
    tolerance: float = 1e-11  #: relative drop of cost below which it stops
    damping: float = 1e-6  #: first damping relative to the curvature

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,), clipped into the bounds."""
        refuse(self, problem)
        mapped = Mapped(problem)
        x = np.clip(np.asarray(start, dtype=float), problem.lower, problem.upper)
        gram, mu, message = mapped.gram(x), self.damping, "iteration limit reached"
        steps = 0
        while steps < self.max_iterations:
            steps += 1
            trial = _step(problem, gram, x, mu)
            candidate = mapped.gram(trial)
            drop = gram.square - candidate.square
            if not np.isfinite(candidate.square) or drop < 0:
                mu *= 10
                if mu > 1e8 or abs(drop) <= self.tolerance * gram.square:
                    message = "no further descent"
                    break
                continue
            done = drop <= self.tolerance * gram.square
            x, gram, mu = trial, candidate, max(mu / 10, 1e-14)
            if done:
                message = "converged"
                break
        return Solution(problem, x, steps, message)


def _step(problem: Problem, gram: Gram, x: Array, mu: float) -> Array:
    """The damped step from x; unknowns that would leave a bound stop there, the others adapt."""
    S = problem.scale
    G, g = gram.matrix * np.outer(S, S), gram.vector * S
    low, high = (problem.lower - x) / S, (problem.upper - x) / S
    diagonal = np.maximum(np.diag(G), 1e-12 * max(np.diag(G).max(initial=0.0), 1e-300))
    A = G + mu * np.diag(diagonal)
    delta = np.zeros(len(x))
    free = ~(((low >= 0) & (g > 0)) | ((high <= 0) & (g < 0)))
    while free.any():
        right = -(g + A[:, ~free] @ delta[~free])[free]
        delta[free] = np.linalg.solve(A[np.ix_(free, free)], right)
        out = free & ((delta < low) | (delta > high))
        if not out.any():
            break
        delta[out] = np.clip(delta[out], low[out], high[out])
        free &= ~out
    return np.clip(x + S * delta, problem.lower, problem.upper)

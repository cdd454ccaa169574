r"""Levenberg-Marquardt on Gram matrices (Madsen, Nielsen, Tingleff 2004, algorithm 3.16).

.. math:: (J^T J + \mu D)\, \delta = -J^T r, \qquad D = \mathrm{diag}(J^T J)

Where a step keeps less than half of its promise, the next ones turn with the valley by the second
derivative along them (Transtrum and Sethna 2012, arXiv:1201.5885, sec. 3), and the damping follows
what a step gained (Nielsen 1999, IMM-REP-1999-05). Bounds are kept by projection: unknowns that a
step would push out of a bound leave the step. Memory does not grow with the rows.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import Count, NotNegative
from plumbline.optim.core import constants
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.mapped import Gram, Mapped, Summed
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.core.solvers.solver import OfRows, refuse


@dataclass(frozen=True)
class LevenbergMarquardt(OfRows):
    """Options of the solver."""

    max_iterations: Count = 60  #: steps tried at most
    tolerance: NotNegative = 1e-11  #: relative drop of cost below which it stops
    damping: NotNegative = 1e-6  #: first damping relative to the curvature
    #: standard errors by which the unknowns may still move where it stops; 0 if they may not
    still: NotNegative = 0.0

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,), clipped into the bounds."""
        refuse(self, problem)
        return self.on(Mapped(problem), start)

    def on(self, mapped: Summed, start: ArrayLike) -> Solution:
        """The same by sums over the problem's rows, however they are worked out."""
        problem = mapped.problem
        x = np.clip(np.asarray(start, dtype=float), problem.lower, problem.upper)
        gram, mu, message = mapped.gram(x), self.damping, "iteration limit reached"
        steps, growth, bent = 0, constants.GROWTH, False
        while steps < self.max_iterations:
            steps += 1
            trial = damped_step(problem, gram, x, mu)
            promise = promised(gram, trial - x)
            if 0.0 < promise * gram.count <= self.still**2 * gram.square:  # Newton's decrement
                message = "converged"
                break
            if bent:
                trial = _around_the_bend(mapped, gram, x, trial, mu)
            candidate = mapped.gram(trial)
            drop = gram.square - candidate.square
            bent = bent or drop < constants.KEPT * promise
            if not np.isfinite(candidate.square) or drop < 0:
                mu, growth = mu * growth, growth * constants.GROWTH
                if mu > constants.HOPELESS or abs(drop) <= self.tolerance * gram.square:
                    message = "no further descent"
                    break
                continue
            done = drop <= self.tolerance * gram.square
            x, gram = trial, candidate
            if done:
                message = "converged"
                break
            # Where half of what was promised was gained the damping stays (Nielsen 1999): in a
            # valley that bends each other step had been too long for nothing.
            relief = max(constants.LEAST, 1.0 - (2.0 * drop / promise - 1.0) ** 3)
            mu, growth = max(mu * relief, constants.LEAST_DAMPING), constants.GROWTH
        return Solution(problem, x, steps, message).judged_by(gram)


def _around_the_bend(mapped: Summed, gram: Gram, x: Array, trial: Array, mu: float) -> Array:
    """The step from x that follows the bend of a valley to second order (ibid., eq. 11)."""
    curvature = mapped.curvature_along(x, trial - x)
    turned = replace(gram, vector=gram.vector + 0.5 * curvature)
    found, scale = damped_step(mapped.problem, turned, x, mu), mapped.problem.scale
    more, straight = (np.linalg.norm(d / scale) for d in (found - trial, trial - x))
    return found if 2.0 * more <= constants.MOST_TURN * straight else trial


def promised(gram: Gram, step: Array) -> float:
    """By how much the square drops along a step (P,) if the residuals are linear."""
    return float(-2.0 * gram.vector @ step - step @ gram.matrix @ step)


def damped_step(problem: Problem, gram: Gram, x: Array, mu: float) -> Array:
    """The damped step from x; unknowns that would leave a bound stop there, the others adapt."""
    S = problem.scale
    G, g = gram.matrix * np.outer(S, S), gram.vector * S
    low, high = (problem.lower - x) / S, (problem.upper - x) / S
    diagonal = np.maximum(
        np.diag(G), constants.LEAST_DIAGONAL * max(np.diag(G).max(initial=0.0), 1e-300)
    )
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

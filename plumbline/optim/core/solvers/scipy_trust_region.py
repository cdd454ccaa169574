"""SciPy's trust-region reflective least squares on the exact Jacobian.

Branch, Coleman, Li (1999), SIAM J. Scientific Computing 21(1). It holds the whole Jacobian in
memory: for recordings of up to some ten thousand rows.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers.solver import OfRows, refuse


@dataclass(frozen=True)
class TrustRegion(OfRows):
    """Options of the solver."""

    max_iterations: int = 200  #: evaluations at most
    tolerance: float = 1e-12  #: relative tolerance on cost, step and gradient

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,), clipped into the bounds."""
        refuse(self, problem)
        mapped = Mapped(problem)
        x = np.clip(np.asarray(start, dtype=float), problem.lower, problem.upper)
        free = problem.lower < problem.upper  # SciPy refuses unknowns that their bounds fix

        def filled(z: Array) -> Array:
            full = x.copy()
            full[free] = z
            return full

        def residuals(z: Array) -> Array:
            s, _ = mapped.shared(filled(z))
            return np.concatenate([mapped.white_residuals(filled(z)).ravel(), s])

        def jacobian(z: Array) -> Array:
            parts = [J.reshape(r.size, problem.size) for _, r, J in mapped.whitened(filled(z))]
            return np.vstack([*parts, mapped.shared(filled(z))[1].T])[:, free]

        found = scipy.optimize.least_squares(
            residuals,
            x[free],
            jacobian,
            bounds=(problem.lower[free], problem.upper[free]),
            x_scale=problem.scale[free],
            ftol=self.tolerance,
            xtol=self.tolerance,
            gtol=self.tolerance,
            max_nfev=self.max_iterations,
        )
        return Solution(problem, filled(found.x), int(found.nfev), str(found.message))

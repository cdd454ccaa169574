"""SciPy's trust-region reflective least squares on the exact Jacobian.

Branch, Coleman, Li (1999), SIAM J. Scientific Computing 21(1). It holds the whole Jacobian in
memory: for recordings of up to some ten thousand rows.

SciPy's SLSQP (Kraft 1988, DFVLR-FB 88-28) with exact gradients: dense, for some 100 unknowns.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy
from numpy.typing import ArrayLike

from plumbline.declared import Count, Declared, NotNegative
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.core.solvers.solver import OfRows, refuse


@dataclass(frozen=True)
class TrustRegion(OfRows):
    """Options of the solver."""

    max_iterations: Count = 200  #: evaluations at most
    tolerance: NotNegative = 1e-12  #: relative tolerance on cost, step and gradient

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


@dataclass(frozen=True)
class Slsqp(Declared):
    """Options of the solver."""

    max_iterations: Count = 1000  #: iterations at most
    tolerance: NotNegative = 1e-12  #: on the objective in units of its start

    bounds: ClassVar[bool] = True
    constraints: ClassVar[bool] = True
    objective: ClassVar[bool] = True
    rows: ClassVar[bool] = True

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,), clipped into the bounds."""
        refuse(self, problem)
        p, mapped = problem, Mapped(problem)
        first = np.clip(np.asarray(start, dtype=float), p.lower, p.upper)
        size = abs(mapped.cost(first)) or 1.0

        def cost(z: Array) -> tuple[float, Array]:
            x = z * p.scale
            return mapped.cost(x) / size, mapped.gradient(x) * p.scale / size

        found = scipy.optimize.minimize(
            cost,
            first / p.scale,
            jac=True,
            method="SLSQP",
            bounds=scipy.optimize.Bounds(p.lower / p.scale, p.upper / p.scale),
            constraints=_constraints(mapped),
            options={"maxiter": self.max_iterations, "ftol": self.tolerance},
        )
        x = np.clip(found.x * p.scale, p.lower, p.upper)
        return Solution(p, x, int(found.nit), str(found.message), success=bool(found.success))


def _constraints(mapped: Mapped) -> Any:
    """Equations, then what has a lower bound, then what has an upper one, each at least zero."""
    p = mapped.problem
    equal = p.g_lower == p.g_upper
    low, high = np.isfinite(p.g_lower) & ~equal, np.isfinite(p.g_upper) & ~equal
    sides = (("eq", equal, p.g_lower, 1.0), ("ineq", low, p.g_lower, 1.0))
    return [
        {
            "type": kind,
            "fun": lambda z, k=which, b=bound, s=sign: s * (mapped.constraints(z * p.scale) - b)[k],
            "jac": lambda z, k=which, s=sign: s * mapped.slopes(z * p.scale)[k] * p.scale,
        }
        for kind, which, bound, sign in (*sides, ("ineq", high, p.g_upper, -1.0))
        if which.any()
    ]

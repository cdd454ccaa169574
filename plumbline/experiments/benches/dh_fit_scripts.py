"""What a script would do: SciPy with finite differences.

They get the same compiled misfits, so that time spent on kinematics is no part of the comparison.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares, minimize

from plumbline.optim.core.problem import Problem
from plumbline.optim.core.solution import Solution
from plumbline.optim.dh_fit.gauss_newton import of_links
from plumbline.optim.dh_fit.sums import Pass

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FiniteDifferenceSqp:
    """SLSQP with forward differences: sequential quadratic programming with BFGS, as published."""

    max_iterations: int = 1000  # iterations at most
    tolerance: float = 1e-12  # on the objective in units of its start
    name: str = "slsqp-finite-differences"

    bounds: ClassVar[bool] = True
    constraints: ClassVar[bool] = False
    objective: ClassVar[bool] = False
    rows: ClassVar[bool] = True

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,), clipped into the bounds."""
        own = of_links(problem, self.name)
        statement, readings = own.statement, own.readings
        scale, rows = statement.scale, Pass(statement, readings)
        first = np.clip(np.asarray(start, dtype=float), statement.lower, statement.upper) / scale
        size = rows.objective(first * scale)

        def objective(z: Array) -> float:
            return rows.objective(z * scale) / size

        found = minimize(
            objective,
            first,
            method="SLSQP",
            bounds=list(zip(statement.lower / scale, statement.upper / scale, strict=True)),
            options={"maxiter": self.max_iterations, "ftol": self.tolerance},
        )
        x = np.clip(found.x * scale, statement.lower, statement.upper)
        return Solution(problem, x, int(found.nit), str(found.message))


@dataclass(frozen=True)
class FiniteDifferenceLeastSquares:
    """SciPy's trust region with forward differences on the residual whose square is the loss."""

    tolerance: float = 1e-12  # on objective, step and slope
    name: str = "least-squares-finite-differences"

    bounds: ClassVar[bool] = True
    constraints: ClassVar[bool] = False
    objective: ClassVar[bool] = False
    rows: ClassVar[bool] = True

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,), clipped into the bounds."""
        own = of_links(problem, self.name)
        statement, readings = own.statement, own.readings
        rows, loss = Pass(statement, readings), statement.loss

        def residuals(x: Array) -> Array:
            e = rows.misfits(x)
            size = np.maximum(np.linalg.norm(e, axis=1), 1e-300)
            return np.asarray((e * (np.sqrt(2.0 * loss.values(e)) / size)[:, None]).ravel())

        found = least_squares(
            residuals,
            np.clip(np.asarray(start, dtype=float), statement.lower, statement.upper),
            bounds=(statement.lower, statement.upper),
            x_scale=statement.scale,
            ftol=self.tolerance,
            xtol=self.tolerance,
            gtol=self.tolerance,
            max_nfev=2000,
        )
        return Solution(problem, np.asarray(found.x), int(found.nfev), str(found.message))

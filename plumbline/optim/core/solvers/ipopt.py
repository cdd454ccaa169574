"""IPOPT (Waechter and Biegler 2006) with exact derivatives of the mapped row function.

The Hessian is that of Gauss and Newton unless ``exact_hessian`` asks for the full one: residuals of
a calibration are small, and the full one costs second derivatives of the whole chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.optim.core.problem import Problem
from plumbline.optim.core.solution import Solution


@dataclass(frozen=True)
class Ipopt:
    """Options of the solver.

    Attributes:
        max_iterations: Iterations at most.
        tolerance: IPOPT's own tolerance on the scaled problem.
        exact_hessian: Full second derivatives instead of Gauss-Newton's.
    """

    max_iterations: int = 200
    tolerance: float = 1e-9
    exact_hessian: bool = False
    handles_constraints: bool = True

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,), in unknowns divided by their scale."""
        z, x, objective, hessian = _statement(problem)
        g = cs.Function("g", [problem.x], [problem.constraints])(x)
        unit = float(np.sum(problem.weights)) * max(problem.equations, 1)
        first = np.clip(np.asarray(start, dtype=float), problem.lower, problem.upper)
        cost0 = float(cs.Function("f", [z], [objective])(first / problem.scale))
        size = max(cost0, 1e-30 * unit)
        options: dict[str, Any] = {
            "print_time": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": self.tolerance,
                # Close to the optimum rounding spoils the line search: three tries are enough.
                "acceptable_tol": 10 * self.tolerance,
                "acceptable_iter": 3,
                "max_iter": self.max_iterations,
                "bound_relax_factor": 0.0,
                "nlp_scaling_method": "none",
            },
        }
        if not self.exact_hessian:
            options["hess_lag"] = _gauss_newton(problem, z, hessian, g, size)
        statement: dict[str, Any] = {"x": z, "f": objective / size, "g": g}
        solver = cs.nlpsol("solver", "ipopt", statement, options)
        found = solver(
            x0=first / problem.scale,
            lbx=problem.lower / problem.scale,
            ubx=problem.upper / problem.scale,
            lbg=problem.g_lower,
            ubg=problem.g_upper,
        )
        stats = solver.stats()
        best = found["x"].full().ravel() * problem.scale
        best = np.clip(best, problem.lower, problem.upper)
        return Solution(problem, best, int(stats["iter_count"]), str(stats["return_status"]))


def _statement(problem: Problem) -> tuple[cs.MX, cs.MX, cs.MX, cs.MX]:
    """Scaled unknowns z, unknowns x, the objective and Gauss and Newton's Hessian in z.

    Squares and products are summed up row by row: a Jacobian of all rows is never formed.
    """
    p = problem
    z = cs.MX.sym("z", p.size)
    x = z * p.scale
    weight = cs.SX.sym("weight")
    jacobian = cs.densify(cs.jacobian(p.residual, p.x))
    half = cs.Function("half", [p.x, p.row, weight], [weight * cs.sumsqr(p.residual) / 2])
    product = cs.densify(weight * jacobian.T @ jacobian)
    normal = cs.Function("normal", [p.x, p.row, weight], [product])
    data = (cs.DM(p.rows.T), cs.DM(p.weights).T)
    shared = cs.Function("shared", [p.x], [cs.densify(p.shared)])(x)
    slope = cs.jacobian(shared, z)
    objective = _summed(half, len(p.rows))(x, *data) + cs.sumsqr(shared) / 2
    hessian = _summed(normal, len(p.rows))(x, *data) * cs.DM(np.outer(p.scale, p.scale))
    return z, x, objective, hessian + slope.T @ slope


def _summed(function: cs.Function, count: int) -> cs.Function:
    """The sum of a function of (x, row, weight) over its rows."""
    return function.map(f"sum_of_{function.name()}", "serial", count, [0], [0])


def _gauss_newton(
    problem: Problem, z: cs.MX, objective_hessian: cs.MX, g: cs.MX, size: float
) -> cs.Function:
    sigma = cs.MX.sym("sigma")
    multipliers = cs.MX.sym("multipliers", problem.constraints.numel())
    hessian = sigma / size * objective_hessian
    if problem.constraints.numel():
        hessian = hessian + cs.hessian(cs.dot(multipliers, g), z)[0]
    parameters = cs.MX.sym("p", 0)
    return cs.Function(
        "hess_lag",
        [z, parameters, sigma, multipliers],
        [cs.triu(hessian)],
        ["x", "p", "lam_f", "lam_g"],
        ["triu_hess_gamma_x_x"],
    )

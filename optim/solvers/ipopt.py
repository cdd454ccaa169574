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

from optim.problem import Problem
from optim.solution import Solution


@dataclass(frozen=True)
class Ipopt:
    """Options of the solver.

    Attributes:
        max_iterations: Iterations at most.
        tolerance: IPOPT's own tolerance on the scaled problem.
        exact_hessian: Full second derivatives instead of Gauss-Newton's.
    """

    max_iterations: int = 200
    tolerance: float = 1e-10
    exact_hessian: bool = False
    handles_constraints: bool = True

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve from a start (P,), in unknowns divided by their scale."""
        z, x, objective, jacobian = _statement(problem)
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
                "max_iter": self.max_iterations,
                "bound_relax_factor": 0.0,
                "nlp_scaling_method": "none",
            },
        }
        if not self.exact_hessian:
            options["hess_lag"] = _gauss_newton(problem, z, jacobian, g, size)
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
    """Scaled unknowns z, unknowns x, the objective and the stacked Jacobian in z."""
    p = problem
    z = cs.MX.sym("z", p.size)
    x = z * p.scale
    residual = cs.Function("residual", [p.x, p.row], [cs.densify(p.residual)])
    mapped = residual.map(len(p.rows))(x, cs.DM(p.rows.T))
    weighted = cs.vec(mapped @ cs.diag(cs.DM(np.sqrt(p.weights))))
    shared = cs.Function("shared", [p.x], [cs.densify(p.shared)])(x)
    stacked = cs.vertcat(weighted, shared)
    return z, x, cs.sumsqr(stacked) / 2, cs.jacobian(stacked, z)


def _gauss_newton(
    problem: Problem, z: cs.MX, jacobian: cs.MX, g: cs.MX, size: float
) -> cs.Function:
    sigma = cs.MX.sym("sigma")
    multipliers = cs.MX.sym("multipliers", problem.constraints.numel())
    hessian = sigma / size * (jacobian.T @ jacobian)
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

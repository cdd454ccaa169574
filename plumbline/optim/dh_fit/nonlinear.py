r"""The same problem as a nonlinear programme, for IPOPT and for CasADi's SQP.

.. math:: \min_z\ F(S z) / F_0 \quad\text{s.t.}\quad l \le S z \le u, \qquad
          B = \begin{pmatrix} I \\ \partial m / \partial x \end{pmatrix}^T
              \Bigl( \sum_i K_i^T \nabla^2\phi(e_i) K_i \Bigr)
              \begin{pmatrix} I \\ \partial m / \partial x \end{pmatrix}

with K the Jacobian of a row in x and in the frame's twelve numbers m. Sums run over the readings
inside of a CasADi map: nothing is unrolled. The gradient comes from CasADi, the Hessian is the
generalised Gauss-Newton matrix B, or, for SQP as it was published, that of Broyden, Fletcher,
Goldfarb and Shanno (Nocedal and Wright 2006, procedure 18.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from plumbline.optim.dh_fit.gauss_newton import Array, Found
from plumbline.optim.dh_fit.statement import Readings, Statement, unpacked


@dataclass(frozen=True)
class Ipopt:
    """IPOPT (Waechter and Biegler 2006, Math. Programming 106).

    Attributes:
        max_iterations: Iterations at most.
        tolerance: Its own tolerance, of the scaled problem.
    """

    max_iterations: int = 300
    tolerance: float = 1e-10
    name: str = "ipopt"

    def solve(self, statement: Statement, readings: Readings, start: Array) -> Found:
        """Solve from a start (P,), clipped into the bounds."""
        options = {
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": self.tolerance,
                # At a corner of the norms rounding hides descent long before slopes vanish.
                "acceptable_tol": 1e-3,
                "acceptable_compl_inf_tol": self.tolerance,
                "acceptable_obj_change_tol": 1e-12,
                "acceptable_iter": 3,
                "max_iter": self.max_iterations,
                "bound_relax_factor": 0.0,
                "nlp_scaling_method": "none",
                "mu_strategy": "adaptive",
            }
        }
        # Tolerances speak of the start's objective; the second round makes it the optimum's.
        first = _solve("ipopt", options, statement, readings, start, hessian=True)
        second = _solve("ipopt", options, statement, readings, first.x, hessian=True)
        return Found(second.x, first.iterations + second.iterations, second.message)


@dataclass(frozen=True)
class Sqp:
    """CasADi's sequential quadratic programming, its steps by the active-set solver qrqp.

    Attributes:
        max_iterations: Iterations at most.
        tolerance: On the gradient and the step of the scaled problem.
        bfgs: Hessian by BFGS updates, as published, instead of Gauss-Newton's.
    """

    max_iterations: int = 1000
    tolerance: float = 1e-9
    bfgs: bool = False
    name: str = "sqp"

    def solve(self, statement: Statement, readings: Readings, start: Array) -> Found:
        """Solve from a start (P,), clipped into the bounds."""
        options: dict[str, Any] = {
            "print_header": False,
            "print_iteration": False,
            "print_status": False,
            "error_on_fail": False,
            "max_iter": self.max_iterations,
            "tol_du": self.tolerance,
            "min_step_size": 1e-14,
            "max_iter_ls": 60,
            "beta": 0.5,
            "merit_memory": 1,
            "qpsol": "qrqp",
            "qpsol_options": {"print_iter": False, "print_header": False, "error_on_fail": False},
        }
        if self.bfgs:
            options["hessian_approximation"] = "limited-memory"
        return _solve("sqpmethod", options, statement, readings, start, hessian=not self.bfgs)


def _solve(
    plugin: str,
    options: dict[str, Any],
    statement: Statement,
    readings: Readings,
    start: Array,
    *,
    hessian: bool,
) -> Found:
    scale, lower, upper = statement.scale, statement.lower, statement.upper
    first = np.clip(start, lower, upper)
    z = cs.MX.sym("z", statement.size)
    x = z * scale
    extended = cs.vertcat(x, statement.frame_function(x)[0])
    objective = _summed(statement, readings, "cost")(extended)
    size = max(float(cs.Function("F", [z], [objective])(first / scale)), 1e-30)
    options = {"print_time": False, **options}
    if hessian:
        options["hess_lag"] = _hessian(plugin, statement, readings, z, size)
    solver = cs.nlpsol("solver", plugin, {"x": z, "f": objective / size}, options)
    found = solver(x0=first / scale, lbx=lower / scale, ubx=upper / scale)
    stats = solver.stats()
    best = np.clip(found["x"].full().ravel() * scale, lower, upper)
    return Found(best, int(stats["iter_count"]), str(stats["return_status"]))


def _summed(statement: Statement, readings: Readings, what: str) -> cs.Function:
    """``(x, m) -> `` the mean over the readings of a row's cost, or of its Gauss-Newton matrix."""
    m = cs.SX.sym("m", 12)
    v = cs.vertcat(statement.x, m)
    a = statement.reading
    misfit = statement.tip - unpacked(m).point(a)
    if what == "cost":
        value = statement.loss.cost(misfit)
    else:
        K = cs.jacobian(misfit, v)
        value = cs.densify(K.T @ statement.loss.curvature(misfit) @ K)
    row = cs.Function(what, [v, statement.q, a], [value / len(readings)])
    total = row.map(f"sum_of_{what}", "serial", len(readings), [0], [0])
    point = cs.MX.sym("v", v.numel())
    summed = total(point, cs.DM(readings.q.T), cs.DM(readings.tips.T))
    return cs.Function(f"mean_{what}", [point], [summed])


def _hessian(
    plugin: str, statement: Statement, readings: Readings, z: cs.MX, size: float
) -> cs.Function:
    sigma, none, p = cs.MX.sym("sigma"), cs.MX.sym("lam", 0), cs.MX.sym("p", 0)
    x = z * statement.scale
    m, slope = statement.frame_function(x)
    K = cs.vertcat(cs.MX.eye(statement.size), slope)
    inner = _summed(statement, readings, "matrix")(cs.vertcat(x, m))
    outer = cs.DM(np.outer(statement.scale, statement.scale))
    matrix = sigma / size * (K.T @ inner @ K) * outer
    # Rounding makes it a little unsymmetric, which a solver may refuse.
    matrix = (matrix + matrix.T) / 2
    half = plugin == "ipopt"
    name = "triu_hess_gamma_x_x" if half else "hess_gamma_x_x"
    result = cs.triu(matrix) if half else matrix
    inputs = ["x", "p", "lam_f", "lam_g"]
    return cs.Function("hess_lag", [z, p, sigma, none], [result], inputs, [name])

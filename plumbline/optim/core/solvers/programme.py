r"""A problem as a nonlinear programme for CasADi's solvers, compiled once a statement.

.. math:: \min_z\ \tfrac1{F_0}\Bigl(\tfrac12 \sum_k w_k |r(Sz; row_k)|^2 + \tfrac12 |s(Sz)|^2
          + f(Sz)\Bigr) \quad\text{s.t.}\quad l \le S z \le u,\ \ g_l \le g(Sz) \le g_u

with S the scales, and :math:`F_0` the squares' cost at the start, 1 where there are none. Squares
and products are summed up row by row: a Jacobian of all rows is never formed. Their Hessian is that
of Gauss and Newton unless the full one is asked for: residuals of a calibration are small, and the
full one costs second derivatives of the whole chain. That of f and g is exact.

IPOPT (Waechter and Biegler 2006, Math. Programming 106) with exact derivatives.

FATROP (Vanroye et al. 2023, IROS): for unknowns that are states and controls of stages.

The statement must stand as it looks for it: stage by stage states, then controls; dynamics, then
the rest of a stage.

CasADi's sequential quadratic programming, its steps by the active-set solver qrqp.

Andersson and Rawlings 2018, IFAC-PapersOnLine 51(20). Globalised by a line search on a merit
function (Nocedal and Wright 2006, algorithm 18.3); with ``bfgs`` its Hessian is that of Broyden,
Fletcher, Goldfarb and Shanno (procedure 18.2). Its quadratic programmes must have a bottom: where
the Hessian has none, as that of a linear objective, take IPOPT.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import StrEnum
from functools import lru_cache
from typing import Any, ClassVar, Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import Count, Declared, NotNegative
from plumbline.errors import PlumblineError
from plumbline.optim.core.constants import LEAST_COST
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.core.solvers.solver import refuse


class Hessian(StrEnum):
    """What stands for the Hessian of the squares."""

    EXACT = "exact"
    GAUSS_NEWTON = "gauss-newton"
    UPDATED = "updated"


class Programmed(Declared, ABC):
    """A solver that CasADi has; its options are the dataclass that derives from it."""

    bounds: ClassVar[bool] = True
    constraints: ClassVar[bool] = True
    objective: ClassVar[bool] = True
    rows: ClassVar[bool] = True
    plugin: ClassVar[str]  # its name there

    @property
    def hessian(self) -> Hessian:
        """What stands for the Hessian."""
        return Hessian.GAUSS_NEWTON

    @abstractmethod
    def settings(self, equality: list[bool]) -> dict[str, Any]:
        """What ``nlpsol`` is given; ``equality`` says which constraints (c) are equations."""

    def solve(
        self, problem: Problem, start: ArrayLike, multipliers: tuple[Array, Array] | None = None
    ) -> Solution:
        """Solve from a start (P,), or refuse; multipliers of bounds (P,) and constraints (c,)."""
        refuse(self, problem)
        p, function = problem, compiled(self, problem)
        first = np.clip(np.asarray(start, dtype=float), p.lower, p.upper)
        warm: dict[str, Array] = {}
        if multipliers is not None:
            warm = {"lam_x0": multipliers[0], "lam_g0": multipliers[1]}
        found = function(
            x0=first / p.scale, lbx=p.lower / p.scale, ubx=p.upper / p.scale, lbg=p.g_lower,
            ubg=p.g_upper, p=_numbers(p, first), **warm,
        )  # fmt: skip
        stats = function.stats()
        x = np.clip(found["x"].full().ravel() * p.scale, p.lower, p.upper)
        forces = found["lam_x"].full().ravel(), found["lam_g"].full().ravel()
        said, steps = str(stats["return_status"]), int(stats["iter_count"])
        return Solution(p, x, steps, said, forces, bool(stats["success"]))


@dataclass(frozen=True)
class _Built:
    """A statement for one solver: equal where its symbols are the very same."""

    solver: Programmed
    symbols: tuple[int, ...]
    count: int
    scale: bytes
    equality: bytes
    problem: Problem = field(compare=False)  # keeps the symbols alive

    @classmethod
    def of(cls, solver: Programmed, p: Problem) -> Self:
        symbols = (p.x, p.residual, p.row, p.shared, p.objective, p.constraints, p.given)
        ids = (*(id(symbol) for symbol in symbols), id(p.curvature))
        equality = (p.g_lower == p.g_upper).tobytes()
        return cls(solver, ids, len(p.rows), p.scale.tobytes(), equality, p)


def compiled(solver: Programmed, problem: Problem) -> cs.Function:
    """CasADi's solver of a statement, built at the first call (PlumblineError: CasADi lacks it)."""
    if not cs.has_nlpsol(solver.plugin):
        raise PlumblineError(f"solver: {solver.plugin!r} is not in this CasADi; take 'ipopt'")
    return _compiled(_Built.of(solver, problem))


def _numbers(p: Problem, first: Array) -> Array:
    """Data of f and g, then F_0, weights and rows, where there are squares."""
    if not p.has_squares:
        return p.data
    least = LEAST_COST * float(np.sum(p.weights)) * max(p.equations, 1)
    cost = max(Mapped(p).cost(first), least, np.finfo(float).tiny)
    return np.concatenate([p.data, [cost], p.weights, p.rows.ravel()])


@lru_cache(maxsize=64)
def _compiled(built: _Built) -> cs.Function:
    p, solver = built.problem, built.solver
    z, data = cs.MX.sym("z", p.size), cs.MX.sym("given", p.given.numel())
    x = z if (p.scale == 1.0).all() else z * p.scale
    f, g = _others(p, x, data)
    size, parameters, normal = cs.MX(1), data, None
    if p.has_squares:
        size, weights = cs.MX.sym("size"), cs.MX.sym("weights", len(p.rows))
        rows = cs.MX.sym("rows", p.row.numel(), len(p.rows))
        parameters = cs.vertcat(data, size, weights, cs.vec(rows))
        cost, normal = _sums(p, z, x, rows, weights)
        f = (f + cost) / size
    options: dict[str, Any] = {"print_time": False, "calc_lam_p": False}
    options |= solver.settings(np.frombuffer(built.equality, dtype=bool).tolist())
    known = p.curvature is not None or (normal is not None and solver.hessian != Hessian.EXACT)
    if known and solver.hessian != Hessian.UPDATED:
        sigma, forces = cs.MX.sym("sigma"), cs.MX.sym("forces", g.numel())
        inputs = [z, parameters, sigma, forces]
        matrix = _bend(p, z, x, data, sigma / size, forces)
        if normal is not None:
            matrix = matrix + sigma / size * normal
        options["hess_lag"] = _hessian(solver.plugin, inputs, matrix)
    return cs.nlpsol("programme", solver.plugin, {"x": z, "p": parameters, "f": f, "g": g}, options)


def _sums(p: Problem, z: cs.MX, x: cs.MX, rows: cs.MX, weights: cs.MX) -> tuple[cs.MX, cs.MX]:
    """The squares' cost, and Gauss and Newton's Hessian of it in z, summed over the rows."""
    weight = cs.SX.sym("weight")
    jacobian = cs.densify(cs.jacobian(p.residual, p.x))
    shared = cs.Function("shared", [p.x], [cs.densify(p.shared)])(x)
    slope = cs.jacobian(shared, z)
    cost, normal = cs.sumsqr(shared) / 2, slope.T @ slope
    if len(p.rows):
        half = weight * cs.sumsqr(p.residual) / 2
        product = cs.densify(weight * jacobian.T @ jacobian)
        outer = cs.DM(np.outer(p.scale, p.scale))
        cost += _summed(p, weight, half, "half")(x, rows, weights.T)
        normal += _summed(p, weight, product, "normal")(x, rows, weights.T) * outer
    return cost, normal


def _summed(p: Problem, weight: cs.SX, value: cs.SX, name: str) -> cs.Function:
    """The sum of an expression of (x, row, weight) over the rows."""
    one = cs.Function(name, [p.x, p.row, weight], [value])
    return one.map(f"sum_of_{name}", "serial", len(p.rows), [0], [0])


def _others(p: Problem, x: cs.MX, data: cs.MX) -> tuple[cs.MX, cs.MX]:
    """F and g; written out, as calls within calls take longer."""
    both = cs.Function("others", [p.x, p.given], [p.objective, p.constraints])
    f, g = both.call([x, data], isinstance(p.x, cs.MX), False)
    return f, g


def _bend(p: Problem, z: cs.MX, x: cs.MX, data: cs.MX, sigma: cs.MX, forces: cs.MX) -> cs.MX:
    """The Hessian of ``sigma f + forces . g`` in z."""
    if p.curvature is not None:
        outer = 1.0 if x is z else cs.DM(np.outer(p.scale, p.scale))
        return p.curvature.call([x, data, sigma, forces], True, False)[0] * outer
    f, g = _others(p, x, data)
    return cs.hessian(sigma * f + cs.dot(forces, g), z)[0]


def _hessian(plugin: str, inputs: list[cs.MX], matrix: cs.MX) -> cs.Function:
    """IPOPT takes the upper half, the others all of it, which rounding must not make uneven."""
    names = ["x", "p", "lam_f", "lam_g"]
    if plugin == "ipopt":
        return cs.Function("hess_lag", inputs, [cs.triu(matrix)], names, ["triu_hess_gamma_x_x"])
    even = (matrix + matrix.T) / 2
    return cs.Function("hess_lag", inputs, [even], names, ["hess_gamma_x_x"])


@dataclass(frozen=True)
class Ipopt(Programmed):
    """Options of the solver."""

    max_iterations: Count = 200  #: iterations at most
    tolerance: NotNegative = 1e-9  #: IPOPT's own tolerance on the scaled problem
    exact_hessian: bool = False  #: full second derivatives of the squares instead of Gauss-Newton's
    #: IPOPT's other options by their names there; these go before our own
    further: tuple[tuple[str, float | str], ...] = ()
    #: whether functions are expanded into scalar operations: faster for small ones
    expand: bool = False

    plugin: ClassVar[str] = "ipopt"

    @property
    def hessian(self) -> Hessian:
        """What stands for the Hessian."""
        return Hessian.EXACT if self.exact_hessian else Hessian.GAUSS_NEWTON

    def settings(self, equality: list[bool]) -> dict[str, Any]:
        """What ``nlpsol`` is given."""
        own = {
            "print_level": 0,
            "sb": "yes",
            "tol": self.tolerance,
            # Close to the optimum rounding spoils the line search: three tries are enough.
            "acceptable_tol": 10 * self.tolerance,
            "acceptable_iter": 3,
            "max_iter": self.max_iterations,
            "bound_relax_factor": 0.0,
            "nlp_scaling_method": "none",
        }
        quiet = {"show_eval_warnings": False, "error_on_fail": False, "expand": self.expand}
        return quiet | {"ipopt": own | dict(self.further)}


@dataclass(frozen=True)
class Fatrop(Programmed):
    """Options of the solver."""

    max_iterations: Count = 200  #: iterations at most
    tolerance: NotNegative = 1e-8  #: its own
    barrier: NotNegative = 1e-1  #: its first barrier parameter

    rows: ClassVar[bool] = False
    plugin: ClassVar[str] = "fatrop"

    def settings(self, equality: list[bool]) -> dict[str, Any]:
        """What ``nlpsol`` is given; ``equality`` says which constraints (c) are equations."""
        own = {"print_level": 0, "tol": self.tolerance, "mu_init": self.barrier}
        found = {"expand": True, "error_on_fail": False, "equality": equality}
        return found | {
            "structure_detection": "auto",
            "fatrop": own | {"max_iter": self.max_iterations},
        }


@dataclass(frozen=True)
class Sqp(Programmed):
    """Options of the solver."""

    max_iterations: Count = 1000  #: iterations at most
    tolerance: NotNegative = 1e-9  #: on the gradient and the constraints of the scaled problem
    bfgs: bool = False  #: hessian by updates instead of Gauss-Newton's or the exact one

    plugin: ClassVar[str] = "sqpmethod"

    @property
    def hessian(self) -> Hessian:
        """What stands for the Hessian."""
        return Hessian.UPDATED if self.bfgs else Hessian.GAUSS_NEWTON

    def settings(self, equality: list[bool]) -> dict[str, Any]:
        """What ``nlpsol`` is given."""
        silent = {"print_iter": False, "print_header": False, "error_on_fail": False}
        updates = {"hessian_approximation": "limited-memory"} if self.bfgs else {}
        return updates | {
            "print_header": False,
            "print_iteration": False,
            "print_status": False,
            "error_on_fail": False,
            "max_iter": self.max_iterations,
            "tol_du": self.tolerance,
            "tol_pr": self.tolerance,
            "min_step_size": 1e-14,
            "max_iter_ls": 60,
            "beta": 0.5,
            "merit_memory": 1,
            "qpsol": "qrqp",
            "qpsol_options": silent,
        }

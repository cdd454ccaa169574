r"""A whole sweep of a needle as one problem in symbols; compiled once, solved for any lesion.

.. math:: \min_{q_1 .. q_K}\ \tfrac12 \sum_k |q_{k+1} - q_k|^2
          + \sum_k \bigl( -\tfrac{\mu}{2} \ln (w^2(q_k) + w_0^2) + \tfrac{c}{2} |q_k - q_0|^2 \bigr)

.. math:: \text{s.t.}\quad r_k(q_k) = 0, \quad |q_{k+1} - q_k| \le s, \quad
          q_{min} \le q_k \le q_{max}

The first sum asks for a smooth path, the logarithm keeps the needle's task away from
singularities, the last term decides what is left free. Joints are counted in radians, slides in
arm lengths. Angles that cannot be reached are released: their equations get infinite bounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from optim.pointing.faults import Array
from optim.pointing.task import EQUATIONS, ROW, NeedleTask, across

DATA = ROW + 6  # and two directions across the needle


@dataclass(frozen=True)
class SweepWeights:
    """What the path is chosen for, beside holding the needle.

    Attributes:
        manipulability: mu, against singularities.
        home: c, towards the middle of the joints' ranges.
        floor: w_0, below which the logarithm is cut off: keeps it finite at a singularity.
    """

    manipulability: float = 1e-3
    home: float = 1e-5
    floor: float = 1e-3


@dataclass(frozen=True, eq=False)
class SweepStatement:
    """The problem for K angles of one task.

    Attributes:
        task: The arm and its needle.
        count: K.
        weights: What the path is chosen for.
    """

    task: NeedleTask
    count: int
    weights: SweepWeights

    @cached_property
    def stage(self) -> tuple[cs.Function, cs.Function, cs.Function]:
        """Of one angle: the equations, the cost, and the Lagrangian's Hessian (n, n)."""
        task, w = self.task, self.weights
        x, data = cs.SX.sym("x", task.chain.n), cs.SX.sym("data", DATA)
        force, sigma = cs.SX.sym("force", EQUATIONS), cs.SX.sym("sigma")
        q = x * task.steps
        r = task.residual(q, data[:ROW], cs.reshape(data[ROW:], 3, 2))
        J = cs.jacobian(r, x)
        root = cs.chol(cs.densify(J @ J.T) + w.floor**2 * cs.SX.eye(EQUATIONS))
        spread = 2 * cs.sum1(cs.log(cs.diag(root)))
        home = cs.sumsqr(x - task.home / task.steps)
        cost = -w.manipulability / 2 * spread + w.home / 2 * home
        hessian = cs.hessian(sigma * cost + cs.dot(force, r), x)[0]
        return (
            cs.Function("equations", [x, data], [r]),
            cs.Function("cost", [x, data], [cost]),
            cs.Function("curvature", [x, data, sigma, force], [cs.densify(hessian)]),
        )

    @cached_property
    def solver(self) -> cs.Function:
        """IPOPT (Waechter and Biegler 2006) on the problem, with the exact sparse Hessian."""
        n, K = self.task.chain.n, self.count
        equations, cost, _ = self.stage
        z, p = cs.MX.sym("z", n * K), cs.MX.sym("p", DATA * K)
        Q, data = cs.reshape(z, n, K), cs.reshape(p, DATA, K)
        moves = Q[:, 1:] - Q[:, :-1]
        statement: dict[str, Any] = {
            "x": z,
            "p": p,
            "f": cs.sum2(cost.map(K)(Q, data)) + cs.sumsqr(moves) / 2,
            "g": cs.vertcat(cs.vec(equations.map(K)(Q, data)), cs.vec(moves)),
        }
        options: dict[str, Any] = {
            "print_time": False,
            "show_eval_warnings": False,
            "hess_lag": self._hessian(),
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": 1e-7,
                "constr_viol_tol": 1e-10,
                "acceptable_tol": 1e-5,
                "acceptable_constr_viol_tol": 1e-9,
                "acceptable_iter": 4,
                "max_iter": 60,
                "mu_init": 1e-4,
                "bound_push": 1e-6,
                "bound_frac": 1e-6,
                "slack_bound_push": 1e-6,
                "slack_bound_frac": 1e-6,
                "nlp_scaling_method": "none",
                "bound_relax_factor": 0.0,
            },
        }
        return cs.nlpsol("sweep", "ipopt", statement, options)

    def _hessian(self) -> cs.Function:
        """The Lagrangian's Hessian: one block an angle, and the chain of moves between them."""
        n, K = self.task.chain.n, self.count
        z, p = cs.MX.sym("z", n * K), cs.MX.sym("p", DATA * K)
        sigma, forces = cs.MX.sym("sigma"), cs.MX.sym("forces", EQUATIONS * K + n * (K - 1))
        blocks = self.stage[2].map("curvatures", "serial", K, [2], [])(
            cs.reshape(z, n, K),
            cs.reshape(p, DATA, K),
            sigma,
            cs.reshape(forces[: EQUATIONS * K], EQUATIONS, K),
        )
        D = np.diff(np.eye(K), axis=0)
        chain = cs.DM(cs.sparsify(cs.DM(np.kron(D.T @ D, np.eye(n)))))
        hessian = cs.diagcat(*cs.horzsplit(blocks, n)) + sigma * chain
        return cs.Function(
            "hess_lag", [z, p, sigma, forces], [cs.triu(hessian)],
            ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"],
        )  # fmt: skip

    def solve(
        self, start: Array, rows: Array, held: NDArray[np.bool_], lower: Array, upper: Array,
        longest_step: float,
    ) -> tuple[Array, str, int]:  # fmt: skip
        """Plan from a track.

        Args:
            start: Postures (K, n) [rad or m].
            rows: The task's data (K, 7).
            held: Which angles (K,) shall be held; the others are released.
            lower: Lower limits (n,).
            upper: Upper limits (n,).
            longest_step: s [rad], of arm lengths where a joint slides.

        Returns:
            Postures (K, n), what IPOPT says, and its iterations.
        """
        n, K = self.task.chain.n, self.count
        E = across(rows[:, 3:6]).transpose(0, 2, 1).reshape(K, 6)
        free = np.where(np.repeat(held, EQUATIONS), 0.0, np.inf)
        bound = np.concatenate([free, np.full(n * (K - 1), longest_step)])
        found = self.solver(
            x0=(start / self.task.steps).ravel(),
            p=np.hstack([rows, E]).ravel(),
            lbx=np.tile(lower / self.task.steps, K),
            ubx=np.tile(upper / self.task.steps, K),
            lbg=-bound,
            ubg=bound,
        )
        stats = self.solver.stats()
        q = found["x"].full().reshape(K, n) * self.task.steps
        return np.clip(q, lower, upper), str(stats["return_status"]), int(stats["iter_count"])


@lru_cache(maxsize=8)
def sweep_statement(task: NeedleTask, count: int, weights: SweepWeights) -> SweepStatement:
    """The statement for K angles, compiled once."""
    return SweepStatement(task, count, weights)

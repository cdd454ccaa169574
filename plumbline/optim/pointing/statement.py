r"""A whole sweep of a needle as one problem in symbols; compiled once, solved for any lesion.

.. math:: \min_{q_1 .. q_K}\ \tfrac12 \sum_k |q_{k+1} - q_k|^2
          + \sum_k \bigl( -\tfrac{\mu}{2} \ln (w^2(q_k) + w_0^2) + \tfrac{c}{2} |q_k - q_0|^2 \bigr)

.. math:: \text{s.t.}\quad r_k(q_k) = 0, \quad |q_{k+1} - q_k| \le s, \quad
          q_{min} \le q_k \le q_{max}

.. math:: g_{km}(q_k) + e_{km} \ge 0, \quad e_{km} \ge 0, \quad \text{at the cost } \rho\, e_{km}

The first sum asks for a smooth path, the logarithm keeps the needle's task away from
singularities, the last term decides what is left free. Joints are counted in radians, slides in
arm lengths. Angles that cannot be reached are released: their equations get infinite bounds. The
rows g are planes that the arm is to stay in front of (:mod:`plumbline.optim.pointing.between`),
there only if a path without them came too near something; one that cannot be kept has a slack of
its own, by an exact penalty (Nocedal and Wright 2006, sec. 17.2).
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np

from plumbline.declared import Declared, NotNegative
from plumbline.optim.core.problem import Array, Flags, Problem
from plumbline.optim.core.solvers import Ipopt, Solver
from plumbline.optim.pointing.between import Planes, kept, points
from plumbline.optim.pointing.constants import EQUATIONS, PENALTY, ROW, SLOTS
from plumbline.optim.pointing.task import NeedleTask, across

DATA = ROW + 6  # and two directions across the needle


IPOPT: Solver = Ipopt(
    max_iterations=60,
    tolerance=1e-7,
    further=(
        ("constr_viol_tol", 1e-10),
        ("acceptable_tol", 1e-5),
        ("acceptable_constr_viol_tol", 1e-9),
        ("acceptable_iter", 4),
        ("mu_init", 1e-4),
        ("bound_push", 1e-6),
        ("bound_frac", 1e-6),
        ("slack_bound_push", 1e-6),
        ("slack_bound_frac", 1e-6),
    ),
)  # from a track that is nearly the path


@dataclass(frozen=True)
class SweepWeights(Declared):
    """What the path is chosen for, beside holding the needle."""

    manipulability: NotNegative = 1e-3  # mu, against singularities
    home: NotNegative = 1e-5  # c, towards the middle of the joints' ranges
    # w_0, below which the logarithm is cut off: keeps it finite at a singularity
    floor: NotNegative = 1e-3


@dataclass(frozen=True, eq=False)
class SweepStatement:
    """The problem for K angles of one task."""

    task: NeedleTask  # the arm and its needle
    count: int  # K
    weights: SweepWeights  # what the path is chosen for
    keeps_off: bool = False  # whether there are rows of planes

    @property
    def slots(self) -> int:
        """Rows of planes an angle."""
        return SLOTS if self.keeps_off else 0

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
    def planes(self) -> tuple[cs.Function, cs.Function]:
        """Of one angle: by how much its rows are kept (SLOTS,), and their Hessian (n, n)."""
        x, data = cs.SX.sym("x", self.task.chain.n), cs.SX.sym("data", self.width)
        force = cs.SX.sym("force", SLOTS)
        g = kept(self.task, x * self.task.steps, data[ROW - 1], data[DATA:])
        hessian = cs.hessian(cs.dot(force, g), x)[0]
        return (
            cs.Function("planes", [x, data], [g]),
            cs.Function("bend", [x, data, force], [cs.densify(hessian)]),
        )

    @property
    def width(self) -> int:
        """Parameters of one angle."""
        return DATA + self.slots * (4 + points(self.task))

    @cached_property
    def problem(self) -> Problem:
        """The problem of every lesion: :meth:`at` fills in the data and the bounds."""
        n, K, S = self.task.chain.n, self.count, self.slots
        equations, cost, _ = self.stage
        z, p = cs.MX.sym("z", (n + S) * K), cs.MX.sym("p", self.width * K)
        Q, data = cs.reshape(z[: n * K], n, K), cs.reshape(p, self.width, K)
        pointing, moves, slack = data[:DATA, :], Q[:, 1:] - Q[:, :-1], z[n * K :]
        g = [cs.vec(equations.map(K)(Q, pointing)), cs.vec(moves)]
        if S:
            g.append(cs.vec(self.planes[0].map(K)(Q, data)) + slack)
        cost_of_path = cs.sum2(cost.map(K)(Q, pointing)) + cs.sumsqr(moves) / 2
        joints = [f"{name} at {k + 1}" for k in range(K) for name in self.task.chain.joint_names]
        free = np.full((n + S) * K, np.inf)
        return Problem(
            x=z,
            names=(*joints, *(f"slack {k + 1}" for k in range(S * K))),
            lower=-free,
            upper=free,
            scale=np.ones((n + S) * K),
            objective=cost_of_path + PENALTY * cs.sum1(slack),
            constraints=cs.vertcat(*g),
            given=p,
            curvature=self._hessian(),
        )

    def _hessian(self) -> cs.Function:
        """The Lagrangian's Hessian: one block an angle, and the chain of moves between them."""
        n, K, S = self.task.chain.n, self.count, self.slots
        z, p = cs.MX.sym("z", (n + S) * K), cs.MX.sym("p", self.width * K)
        sigma = cs.MX.sym("sigma")
        forces = cs.MX.sym("forces", EQUATIONS * K + n * (K - 1) + S * K)
        Q, data = cs.reshape(z[: n * K], n, K), cs.reshape(p, self.width, K)
        blocks = self.stage[2].map("curvatures", "serial", K, [2], [])(
            Q, data[:DATA, :], sigma, cs.reshape(forces[: EQUATIONS * K], EQUATIONS, K)
        )
        if S:
            blocks += self.planes[1].map(K)(Q, data, cs.reshape(forces[-S * K :], S, K))
        D = np.diff(np.eye(K), axis=0)
        chain = cs.DM(cs.sparsify(cs.DM(np.kron(D.T @ D, np.eye(n)))))
        hessian = cs.diagcat(*cs.horzsplit(blocks, n)) + sigma * chain
        whole = cs.diagcat(hessian, cs.MX(S * K, S * K))
        return cs.Function("curvature", [z, p, sigma, forces], [whole])

    def at(
        self, rows: Array, held: Flags, lower: Array, upper: Array,
        longest_step: float, planes: Planes | None = None,
    ) -> Problem:  # fmt: skip
        """The problem of one lesion's rows (K, 7), of which those ``held`` (K,) are.

        Limits (n,), the longest step s [rad], and planes that the path is asked to keep.
        """
        n, K, S = self.task.chain.n, self.count, self.slots
        E = across(rows[:, 3:6]).transpose(0, 2, 1).reshape(K, 6)
        free = np.where(np.repeat(held, EQUATIONS), 0.0, np.inf)
        bound = np.concatenate([free, np.full(n * (K - 1), longest_step)])
        data = np.hstack([rows, E] if planes is None else [rows, E, planes.data])
        return replace(
            self.problem,
            data=data.ravel(),
            lower=np.concatenate([np.tile(lower / self.task.steps, K), np.zeros(S * K)]),
            upper=np.concatenate([np.tile(upper / self.task.steps, K), np.full(S * K, np.inf)]),
            g_lower=np.concatenate([-bound, np.zeros(S * K)]),
            g_upper=np.concatenate([bound, np.full(S * K, np.inf)]),
        )

    def start(self, q: Array) -> Array:
        """Unknowns of postures (K, n), without slack."""
        return np.concatenate([(q / self.task.steps).ravel(), np.zeros(self.slots * self.count)])

    def postures(self, x: Array) -> Array:
        """Postures (K, n) [rad or m] of unknowns."""
        n = self.task.chain.n
        return np.asarray(x[: n * self.count].reshape(self.count, n) * self.task.steps)


@lru_cache(maxsize=8)
def sweep_statement(
    task: NeedleTask, count: int, weights: SweepWeights, keeps_off: bool = False
) -> SweepStatement:
    """The statement for K angles, compiled once."""
    return SweepStatement(task, count, weights, keeps_off)

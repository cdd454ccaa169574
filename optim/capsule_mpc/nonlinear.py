r"""The statement as a nonlinear program, planes and all: the reference.

Every pair has at every stage a normal n of its own among the unknowns, and a slack s,

.. math:: n \cdot (a - b) + s \ge D \ \text{for all pairs of ends}, \quad |n|^2 \le 1, \quad s \ge 0

so that nothing is frozen and nothing jumps. IPOPT takes second derivatives from the symbols, and
starts from the last solution with a small barrier (Waechter and Biegler 2006, sec. 3.1). FATROP
sees the same unknowns as states and controls of stages (Vanroye et al. 2023, IROS). Obstacles that
are far from the last path are left out at first; the solution is then tried on all of them, and
solved again with those that it comes too near to. What comes out satisfies the whole statement. The
program is built for the next power of two of the obstacles taken.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from kinematics.capsules import plane_gaps, scalar_gap
from optim.capsule_mpc.linearised import nearest_normal
from optim.capsule_mpc.planning import Plan, Ready
from optim.capsule_mpc.scene import FAR
from optim.capsule_mpc.settings import ControlError
from optim.capsule_mpc.statement import OBSTACLE, Shape, Statement

Array = NDArray[np.float64]
WATCH = 8.0  # [mm] from its D, below which an obstacle is taken at once
SHORT = 1e-3  # [mm] by which a solution may come too near to an obstacle that was left out
ROUNDS = 3
REGULAR = 1e-6  # weight of what the statement does not weigh: planes, the last step


@dataclass(frozen=True)
class Nonlinear:
    """Options of the solver.

    Attributes:
        plugin: ``"ipopt"`` or ``"fatrop"``.
        max_iterations: Iterations at most.
        tolerance: The solver's own; None for 1e-4 with IPOPT, 1e-2 with FATROP, which otherwise
            iterates on what the penalty of slack leaves of its dual residual.
        budget: Time that IPOPT may take [s]; None for no limit.
    """

    plugin: str = "ipopt"
    max_iterations: int = 100
    tolerance: float | None = None
    budget: float | None = None

    def ready(self, statement: Statement) -> Ready:
        """Build the program for as many obstacles as are stated; others follow when needed."""
        if not cs.has_nlpsol(self.plugin):
            raise ControlError(f"solver: {self.plugin!r} is not in this CasADi; take 'ipopt'")
        return _NonlinearReady(self, statement)


@dataclass(frozen=True, eq=False)
class _Program:
    """One program: its solver, bounds, and where states, normals and slacks stand."""

    solver: cs.Function
    normals: cs.Function
    low: Array
    high: Array
    g_low: Array
    g_high: Array
    x: NDArray[np.intp]
    d: NDArray[np.intp]
    n: NDArray[np.intp]
    s: NDArray[np.intp]


def stage_constraints(statement: Statement) -> tuple[cs.Function, Array, Array]:
    """``(x, normals, slacks, stage) -> g`` with its bounds: one stage of the program."""
    x, _, stage = statement.symbols
    pairs, planes = statement.pairs, statement.settings.form == "planes"
    normals, slacks = cs.SX.sym("n", 3 * len(pairs)), cs.SX.sym("s", len(pairs))
    rows, low, high = [cs.SX(0, 1)], [], []
    for k, pair in enumerate(pairs):
        if planes:
            n = normals[3 * k : 3 * k + 3]
            gaps = plane_gaps(n, pair.one, pair.two)
            rows += [(gaps[::2] if pair.ball else gaps) - pair.least + slacks[k], cs.sumsqr(n)]
            low += [0.0] * (2 if pair.ball else 4) + [-np.inf]
            high += [np.inf] * (2 if pair.ball else 4) + [1.0]
        else:
            rows.append(scalar_gap(pair.one, pair.two, pair.least) + slacks[k])
            low, high = [*low, 0.0], [*high, np.inf]
    rows += [statement.held, statement.limits]
    low += [0.0] * (statement.held.numel() + statement.limits.numel())
    high += [0.0] * statement.held.numel() + [np.inf] * statement.limits.numel()
    g = cs.vertcat(*rows)
    function = cs.Function("g", [x, normals, slacks, stage], [g])
    return function, np.array(low), np.array(high)


class _Builder:
    """Collects unknowns and constraints in their order, and remembers where they stand."""

    def __init__(self) -> None:
        self.unknowns: list[cs.MX] = []
        self.low: list[float] = []
        self.high: list[float] = []
        self.g: list[cs.MX] = []
        self.g_low: list[float] = []
        self.g_high: list[float] = []
        self.places: dict[str, list[list[int]]] = {"x": [], "d": [], "n": [], "s": []}

    def add(self, name: str, size: int, least: float | Array, most: float | Array) -> cs.MX:
        """New unknowns with bounds."""
        symbol, at = cs.MX.sym(f"{name}{len(self.places[name])}", size), len(self.low)
        self.places[name].append(list(range(at, at + size)))
        self.unknowns.append(symbol)
        self.low.extend(np.broadcast_to(least, size))
        self.high.extend(np.broadcast_to(most, size))
        return symbol

    def demand(self, value: cs.MX, least: Array, most: Array) -> None:
        """New constraints with bounds."""
        self.g.append(value)
        self.g_low.extend(least)
        self.g_high.extend(most)


def build(statement: Statement, options: Nonlinear) -> _Program:
    """The program of a statement."""
    p, n, s, count = statement.settings.p, statement.n, statement.settings, len(statement.pairs)
    constraints, stage_low, stage_high = stage_constraints(statement)
    x_symbol, _, stage_symbol = statement.symbols
    cost = cs.Function("cost", [x_symbol, stage_symbol], [cs.sumsqr(statement.residual)])
    parameters = cs.MX.sym("stages", statement.width, p)
    made, f = _Builder(), cs.MX(0)
    x = made.add("x", n, -np.inf, np.inf)
    for k in range(p + 1):
        held = None
        if k:
            normals = made.add("n", 3 * count if s.form == "planes" else 0, -1.0, 1.0)
            slacks = made.add("s", count, 0.0, np.inf)
            held = constraints(x, _full(normals, count), slacks, parameters[:, k - 1])
            f += cost(x, parameters[:, k - 1]) + s.penalty * cs.sum(slacks)
            f += REGULAR * (cs.sumsqr(normals) + cs.sumsqr(slacks))
        if k < p:
            d = made.add("d", n, -statement.step[k], statement.step[k])
            f += (s.effort + REGULAR) * cs.sumsqr(d)
            ahead = x + d
            x = made.add("x", n, -np.inf, np.inf)
            made.demand(x - ahead, np.zeros(n), np.zeros(n))
        if held is not None:
            made.demand(held, stage_low, stage_high)
    unknowns, g = cs.vertcat(*made.unknowns), cs.vertcat(*made.g)
    equality = [bool(a == b) for a, b in zip(made.g_low, made.g_high, strict=True)]
    problem = {"x": unknowns, "f": f, "g": g, "p": parameters}
    solver = cs.nlpsol("mpc", options.plugin, problem, _options(options, equality))
    bounds = (np.array(b) for b in (made.low, made.high, made.g_low, made.g_high))
    index = (np.array(made.places[name], dtype=np.intp) for name in "xdns")
    return _Program(solver, nearest_normal(statement).map(p), *bounds, *index)


def _full(normals: cs.MX, count: int) -> cs.MX:
    return normals if normals.numel() else cs.MX(3 * count, 1)


def _options(options: Nonlinear, equality: list[bool]) -> dict[str, Any]:
    found: dict[str, Any] = {"print_time": False, "expand": True, "error_on_fail": False}
    if options.plugin == "fatrop":
        return found | {
            "structure_detection": "auto",
            "equality": equality,
            "fatrop": {
                "print_level": 0,
                "tol": options.tolerance or 1e-2,
                "max_iter": options.max_iterations,
                "mu_init": 1e-1,
            },
        }
    ipopt: dict[str, Any] = {
        "print_level": 0,
        "sb": "yes",
        "tol": options.tolerance or 1e-4,
        "max_iter": options.max_iterations,
        "mu_strategy": "monotone",
        "mu_init": 1e-3,
        "warm_start_init_point": "yes",
        "warm_start_bound_push": 1e-6,
        "warm_start_slack_bound_push": 1e-6,
        "warm_start_mult_bound_push": 1e-6,
        # The system is small and well scaled: orderings for large ones take longer than it does.
        "mumps_permuting_scaling": 0,
        "mumps_scaling": 0,
        "mumps_pivot_order": 2,
        "nlp_scaling_method": "none",
        "bound_relax_factor": 0.0,
    }
    if options.budget is not None:
        ipopt["max_wall_time"] = options.budget
    return found | {"calc_lam_p": False, "ipopt": ipopt}


@dataclass(frozen=True, eq=False)
class _NonlinearReady:
    options: Nonlinear
    statement: Statement
    _last: dict[tuple[int, int], dict[str, Array]] = field(default_factory=dict)

    def plan(self, x0: Array, stages: Array, path: Array) -> Plan:
        taken = self._gaps(path, stages) < WATCH
        for _ in range(ROUNDS):
            plan = self._solved(x0, stages, path, taken)
            missed = ~taken & (self._gaps(plan.x, stages) < -SHORT)
            if not plan.solved or not missed.any():
                break
            taken, path = taken | missed, plan.x
        return plan

    def _gaps(self, path: Array, stages: Array) -> Array:
        """Least distance of each obstacle less its D along a path (slots + balls,) [mm]."""
        own, count = self.statement, self.statement.slots + self.statement.balls
        if not count:
            return np.zeros(0)
        gaps = _along(own.shape)(path.T, stages.T).full().min(axis=1)
        fixed = np.array([pair.fixed for pair in own.pairs])
        return gaps[fixed].reshape(-1, count).min(axis=0)

    def _solved(self, x0: Array, stages: Array, path: Array, taken: NDArray[np.bool_]) -> Plan:
        own, values = self._narrowed(stages, taken)
        key = (own.slots, own.balls)
        program = _built(own.shape, self.options)
        low, high = program.low.copy(), program.high.copy()
        low[program.x[0]] = high[program.x[0]] = x0
        found = program.solver(
            x0=_start(program, x0, values, path),
            lbx=low,
            ubx=high,
            lbg=program.g_low,
            ubg=program.g_high,
            p=values.T,
            **self._last.get(key, {}),
        )
        stats = program.solver.stats()
        answer = found["x"].full().ravel()
        solved = bool(stats["success"]) and bool(np.isfinite(answer).all())
        self._last.clear()
        if solved:
            duals = (found[name].full().ravel() for name in ("lam_x", "lam_g"))
            self._last[key] = dict(zip(("lam_x0", "lam_g0"), duals, strict=True))
        slack = float(answer[program.s].max(initial=0.0))
        status = str(stats["return_status"])
        return Plan(answer[program.x[1:]], solved, slack, int(stats["iter_count"]), status)

    def _narrowed(self, stages: Array, taken: NDArray[np.bool_]) -> tuple[Statement, Array]:
        """The statement with the obstacles that are taken, and its stages' parameters."""
        whole = self.statement
        count = whole.slots + whole.balls
        capsules, balls = np.nonzero(taken[: whole.slots])[0], np.nonzero(taken[whole.slots :])[0]
        slots, ball_slots = _bucket(len(capsules), whole.slots), _bucket(len(balls), whole.balls)
        g, p = whole.goals, len(stages)
        table = stages[:, g : g + OBSTACLE * count].reshape(p, count, OBSTACLE)
        kept = np.zeros((p, slots + ball_slots, OBSTACLE))
        kept[:, :, :6] = FAR / 1e3  # far, but harmless to a solver that scales by what it sees
        kept[:, : len(capsules)] = table[:, capsules]
        kept[:, slots : slots + len(balls)] = table[:, whole.slots + balls]
        rest = stages[:, g + OBSTACLE * count :]
        values = np.hstack([stages[:, :g], kept.reshape(p, -1), rest])
        return replace(whole, slots=slots, balls=ball_slots), values


def _start(program: _Program, x0: Array, stages: Array, path: Array) -> Array:
    """Unknowns to start from: a path, its steps, and the normals along it."""
    start = np.zeros(len(program.low))
    start[program.x] = np.vstack([x0, path])
    start[program.d] = np.diff(np.vstack([x0, path]), axis=0)
    if program.n.size:
        start[program.n] = program.normals(path.T, stages.T).full().T
    return start


@lru_cache(maxsize=32)
def _built(shape: Shape, options: Nonlinear) -> _Program:
    return build(shape.statement, options)


@lru_cache(maxsize=32)
def _along(shape: Shape) -> cs.Function:
    statement = shape.statement
    return statement.clearances.map("along", "serial", statement.settings.p, [], [])


def _bucket(count: int, most: int) -> int:
    return min(1 << max(count - 1, 0).bit_length() if count else 0, most)

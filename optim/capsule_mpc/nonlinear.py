r"""The statement as a nonlinear program, planes and all: the reference.

Every pair has at every stage a normal n of its own among the unknowns, and a slack s,

.. math:: n \cdot (a - b) + s \ge D \ \text{for all pairs of ends}, \quad |n|^2 \le 1, \quad s \ge 0

so that nothing is frozen and nothing jumps. IPOPT takes second derivatives from the symbols, and
starts from the last solution with a small barrier (Waechter and Biegler 2006, sec. 3.1). FATROP
sees the same unknowns as states and controls of stages (Vanroye et al. 2023, IROS). Obstacles that
cannot come within reach over the whole horizon are left out first, see :mod:`.statement`; the
program is built for the next power of two of those that are left.
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


def build(statement: Statement, options: Nonlinear) -> _Program:
    """The program of a statement."""
    p, n, s = statement.settings.p, statement.n, statement.settings
    count = len(statement.pairs)
    planes = 3 * count if s.form == "planes" else 0
    constraints, stage_low, stage_high = stage_constraints(statement)
    x_symbol, _, stage_symbol = statement.symbols
    cost = cs.Function("cost", [x_symbol, stage_symbol], [cs.sumsqr(statement.residual)])
    parameters = cs.MX.sym("stages", statement.width, p)
    unknowns: list[cs.MX] = []
    g: list[cs.MX] = []
    low: list[float] = []
    high: list[float] = []
    g_low: list[float] = []
    g_high: list[float] = []
    equality: list[bool] = []
    places: dict[str, list[list[int]]] = {"x": [], "d": [], "n": [], "s": []}
    f = cs.MX(0)
    at = 0

    def add(name: str, size: int, least: float | Array, most: float | Array) -> cs.MX:
        nonlocal at
        symbol = cs.MX.sym(f"{name}{len(places[name])}", size)
        places[name].append(list(range(at, at + size)))
        at += size
        unknowns.append(symbol)
        low.extend(np.broadcast_to(least, size))
        high.extend(np.broadcast_to(most, size))
        return symbol

    def demand(value: cs.MX, least: Array, most: Array) -> None:
        g.append(value)
        g_low.extend(least)
        g_high.extend(most)
        equality.extend((least == most).tolist())

    x = add("x", n, -np.inf, np.inf)
    for k in range(p + 1):
        if k:
            normals = add("n", planes, -1.0, 1.0)
            slacks = add("s", count, 0.0, np.inf)
            f += cost(x, parameters[:, k - 1]) + s.penalty * cs.sum(slacks)
            f += REGULAR * (cs.sumsqr(normals) + cs.sumsqr(slacks))
        if k < p:
            d = add("d", n, -statement.step[k], statement.step[k])
            f += (s.effort + REGULAR) * cs.sumsqr(d)
            ahead = x + d
            if k:
                held = (constraints(x, _full(normals, count), slacks, parameters[:, k - 1]),)
            x = add("x", n, -np.inf, np.inf)
            demand(x - ahead, np.zeros(n), np.zeros(n))
        else:
            held = (constraints(x, _full(normals, count), slacks, parameters[:, k - 1]),)
        if k:
            demand(held[0], stage_low, stage_high)
    statement_nlp = {"x": cs.vertcat(*unknowns), "f": f, "g": cs.vertcat(*g), "p": parameters}
    solver = cs.nlpsol("mpc", options.plugin, statement_nlp, _options(options, statement, equality))
    index = {name: np.array(rows, dtype=np.intp) for name, rows in places.items()}
    return _Program(
        solver,
        nearest_normal(statement).map(p),
        np.array(low),
        np.array(high),
        np.array(g_low),
        np.array(g_high),
        *(index[name] for name in "xdns"),
    )


def _full(normals: cs.MX, count: int) -> cs.MX:
    return normals if normals.numel() else cs.MX(3 * count, 1)


def _options(options: Nonlinear, statement: Statement, equality: list[bool]) -> dict[str, Any]:
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
        own, values = self._narrowed(x0, stages)
        key = (own.slots, own.balls)
        program = _built(own.shape, self.options)
        start = self._start(program, x0, values, path)
        low, high = program.low.copy(), program.high.copy()
        low[program.x[0]] = high[program.x[0]] = x0
        found = program.solver(
            x0=start,
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
        self._last.pop(key, None)
        if solved:
            self._last[key] = {
                "lam_x0": found["lam_x"].full().ravel(),
                "lam_g0": found["lam_g"].full().ravel(),
            }
        slack = float(answer[program.s].max(initial=0.0))
        status = str(stats["return_status"])
        return Plan(answer[program.x[1:]], solved, slack, int(stats["iter_count"]), status)

    def _start(self, program: _Program, x0: Array, stages: Array, path: Array) -> Array:
        start = np.zeros(len(program.low))
        start[program.x] = np.vstack([x0, path])
        start[program.d] = np.diff(np.vstack([x0, path]), axis=0)
        if program.n.size:
            start[program.n] = program.normals(path.T, stages.T).full().T
        return start

    def _narrowed(self, x0: Array, stages: Array) -> tuple[Statement, Array]:
        """The statement with the obstacles within reach only, and its stages' parameters."""
        whole = self.statement
        count = whole.slots + whole.balls
        if not count:
            return whole, stages
        near = reach_function(whole.shape)(x0, stages.T).full().min(axis=1) <= 0.0
        capsules, balls = np.nonzero(near[: whole.slots])[0], np.nonzero(near[whole.slots :])[0]
        slots, ball_slots = _bucket(len(capsules), whole.slots), _bucket(len(balls), whole.balls)
        own = replace(whole, slots=slots, balls=ball_slots)
        g = whole.goals
        table = stages[:, g : g + OBSTACLE * count].reshape(len(stages), count, OBSTACLE)
        kept = np.zeros((len(stages), slots + ball_slots, OBSTACLE))
        kept[:, :, :6] = FAR / 1e3  # far, but harmless to a solver that scales by what it sees
        kept[:, : len(capsules)] = table[:, capsules]
        kept[:, slots : slots + len(balls)] = table[:, whole.slots + balls]
        flat = kept.reshape(len(stages), -1)
        rest = stages[:, g + OBSTACLE * count :]
        return own, np.hstack([stages[:, :g], flat, rest])


@lru_cache(maxsize=32)
def _built(shape: Shape, options: Nonlinear) -> _Program:
    return build(shape.statement, options)


@lru_cache(maxsize=32)
def reach_function(shape: Shape) -> cs.Function:
    """``(x0, stages (t, p)) -> (obstacles, p)``: how near each may come less its D [mm]."""
    statement = shape.statement
    _, x0, stage = statement.symbols
    count = statement.slots + statement.balls
    least: list[cs.SX] = [cs.SX(1e6)] * count
    fixed = [
        never
        for pair, never in zip(statement.pairs, statement.reachable, strict=True)
        if pair.fixed
    ]
    for k, never in enumerate(fixed):
        least[k % count] = cs.fmin(least[k % count], never)
    one = cs.Function("reach", [x0, stage], [cs.densify(cs.vertcat(*least))])
    return one.map("reaches", "serial", statement.settings.p, [0], [])


def _bucket(count: int, most: int) -> int:
    return min(1 << max(count - 1, 0).bit_length() if count else 0, most)

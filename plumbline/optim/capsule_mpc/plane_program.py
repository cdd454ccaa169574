r"""The statement as a nonlinear program: states, steps, planes and slacks, stage by stage.

Every pair has at every stage a plane of its own among the unknowns, and a slack s. The plane's
normal is counted from a chart :math:`(n_0, e_1, e_2)`, an orthonormal frame whose first vector is
the normal between the nearest points of the path that the solver starts from:

.. math:: v = n_0 + w_1 e_1 + w_2 e_2, \qquad |w_i| \le 5, \qquad
          v \cdot (a - b) \ge (D - s)\, |v| \ \text{for all pairs of ends}, \quad s \ge 0

with D wide enough for the step that leads to the stage (:mod:`.pairs`), which says for the
unit vector v / |v| what the statement says of n; margins for errors are taken without their lever,
which has a kink, and left to the net (:mod:`.net`). Two numbers instead of three,
and no equation for a length: the solver's system is smaller by a quarter. A normal turns by
less than 82 degrees between two solutions; what is found satisfies the statement all the same.
Speeds and accelerations are bounded by their norms, as they are stated: for each group of states

.. math:: (m^2 - |d_k|^2) / 2m \ge 0, \qquad (m_a^2 - |d_k - d_{k-1}|^2) / 2 m_a \ge 0

in mm, with m what its pace allows at the state where the step begins.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.kinematics.capsules import nearest_shares, plane_gaps, scalar_gap
from plumbline.optim.capsule_mpc.bodies import sides
from plumbline.optim.capsule_mpc.constants import MM, REGULAR, TURN
from plumbline.optim.capsule_mpc.linearised import frozen_normal, path_function
from plumbline.optim.capsule_mpc.statement import Statement, StatementShape
from plumbline.optim.core.problem import Array, Indices, Problem


@dataclass(frozen=True, eq=False)
class Program:
    """A program, and where everything stands in it."""

    problem: Problem  # what is solved; bounds, data and start come with every plan
    charts: cs.Function  # ``(path (n, p), stages (t, p)) -> charts (9 P, p)``
    first: Indices  # places of the present state (n,)
    # places of steps, states, planes, slacks (p, U) of every stage, and of the steps before where
    # they are states (FATROP)
    unknowns: Indices
    rows: Indices  # places of the constraints (p, R) of every stage
    # number of steps, states, planes, slacks, steps before of a stage
    sizes: tuple[int, int, int, int, int]

    def part(self, which: int) -> Indices:
        """Places (p, .) of steps (0), states (1), planes (2), slacks (3), steps before (4)."""
        begin = sum(self.sizes[:which])
        return self.unknowns[:, begin : begin + self.sizes[which]]

    def one_on(self, multipliers: tuple[Array, Array]) -> tuple[Array, Array]:
        """Multipliers of all stages one stage later, the last one's held."""
        found = multipliers[0].copy(), multipliers[1].copy()
        for places, values in zip((self.unknowns, self.rows), found, strict=True):
            values[places[:-1]] = values[places[1:]]
        return found


def nearest_charts(statement: Statement) -> cs.Function:
    """``(x, stage) -> (9 P,)``: normal between the nearest points of every pair, two sides."""
    x, _, stage = statement.symbols
    found = [cs.SX(0, 1)]
    for pair in statement.pairs:
        s, t = nearest_shares(pair.one, pair.two)
        n = frozen_normal(pair, pair.one.point(s) - pair.two.point(t))
        found += [n, *sides(n)]
    return cs.Function("charts", [x, stage], [cs.densify(cs.vertcat(*found))])


def stage_constraints(statement: Statement, limits: bool) -> tuple[cs.Function, list[float]]:
    """``(x, d, planes, slacks, charts, stage) -> g``: one stage, and what g, from 0 on, may be."""
    x, _, stage = statement.symbols
    d = cs.SX.sym("d", statement.n)
    pairs, planes = statement.pairs_at(x, d), statement.settings.form == "planes"
    w, slacks = cs.SX.sym("w", 2 * len(pairs)), cs.SX.sym("s", len(pairs))
    charts = cs.SX.sym("charts", 9 * len(pairs))
    rows = [(cs.SX(0, 1), np.inf)]
    for k, pair in enumerate(pairs):
        if planes:
            chart, turn = charts[9 * k : 9 * k + 9], w[2 * k : 2 * k + 2]
            v = chart[:3] + turn[0] * chart[3:6] + turn[1] * chart[6:]
            gaps = plane_gaps(v, pair.one, pair.two)
            # The chart is orthonormal, so this is the length of v.
            size = cs.sqrt(1 + cs.sumsqr(turn))
            gap = gaps[:: 2 if pair.ball else 1] - (pair.wide(pair.plain) - slacks[k]) * size
        else:
            gap = scalar_gap(pair.one, pair.two, pair.wide(pair.plain)) + slacks[k]
        rows.append((gap, np.inf))
    rows += [(statement.held, 0.0), *([(statement.limits, np.inf)] if limits else [])]
    most = [bound for value, bound in rows for _ in range(int(value.numel()))]
    given = [x, d, w, slacks, charts, stage]
    return cs.Function("g", given, [cs.vertcat(*(value for value, _ in rows))]), most


def step_limits(statement: Statement) -> cs.Function:
    """``(x, d, before, share, stage) -> (2 G,)``: what d leaves of speed and acceleration."""
    x, _, stage = statement.symbols
    d, before, share = (
        cs.SX.sym(k, m) for k, m in (("d", statement.n), ("b", statement.n), ("s", 1))
    )
    dt, room = statement.settings.dt, []
    for own in statement.blocks:
        fast = dt * share * statement.pace[own.start]
        faster = dt**2 * statement.acceleration[own.start]
        room.append((fast**2 - cs.sumsqr(d[own])) / (2 * fast))
        room.append((faster**2 - cs.sumsqr(d[own] - before[own])) / (2 * faster))
    return cs.Function("steps", [x, d, before, share, stage], [cs.vertcat(*room)])


class _Builder:
    """Collects unknowns and constraints in their order, and remembers where they stand."""

    def __init__(self) -> None:
        self.unknowns: list[cs.MX] = []
        self.low: list[float] = []
        self.high: list[float] = []
        self.g: list[cs.MX] = []
        self.g_high: list[float] = []
        self.places: dict[str, list[list[int]]] = {name: [] for name in ("x", "y", "d", "w", "s")}
        self.g_places: dict[str, list[list[int]]] = {"dynamics": [], "speeds": [], "rows": []}

    def add(self, name: str, size: int, least: float | Array, most: float | Array) -> cs.MX:
        """New unknowns with bounds."""
        symbol, at = cs.MX.sym(f"{name}{len(self.places[name])}", size), len(self.low)
        self.places[name].append(list(range(at, at + size)))
        self.unknowns.append(symbol)
        self.low.extend(np.broadcast_to(least, size))
        self.high.extend(np.broadcast_to(most, size))
        return symbol

    def demand(self, name: str, value: cs.MX, most: list[float]) -> None:
        """New constraints, each at least zero and at most so much."""
        at = len(self.g_high)
        self.g_places[name].append(list(range(at, at + len(most))))
        self.g.append(value)
        self.g_high.extend(most)


def build(statement: Statement, limits: bool, stages_meet_in_states: bool = False) -> Program:
    """The program, with or without limits; FATROP's stages meet in states, so d is one of them."""
    p, n, s, count = statement.settings.p, statement.n, statement.settings, len(statement.pairs)
    constraints, most = stage_constraints(statement, limits)
    x_symbol, _, stage_symbol = statement.symbols
    cost = cs.Function("cost", [x_symbol, stage_symbol], [cs.sumsqr(statement.residual)])
    given = cs.MX.sym("given", (statement.width + 9 * count) * p)
    parameters = cs.reshape(given, statement.width + 9 * count, p)
    stages, charts = parameters[: statement.width, :], parameters[statement.width :, :]
    turns = 2 * count if s.form == "planes" else 0
    made, f, before = _Builder(), cs.MX(0), stages[statement.moved, 0]
    led, turned = path_function(statement.shape)(stages[: statement.goals, :])
    steps, alpha = step_limits(statement), s.confidence.along(p)
    kept = n if stages_meet_in_states else 0
    x = made.add("x", n, -np.inf, np.inf)
    # Stages stand as FATROP looks for them: states, then what is free; dynamics, then the rest.
    for k in range(p + 1):
        held = None
        if k:
            w = made.add("w", turns, -TURN, TURN)
            slacks = made.add("s", count, 0.0, np.inf)
            own = w if turns else cs.MX(2 * count, 1)
            held = constraints(x, before, own, slacks, charts[:, k - 1], stages[:, k - 1])
            f += cost(x, stages[:, k - 1]) + MM * s.penalty * cs.sum(slacks)
            f += REGULAR * (cs.sumsqr(w) + cs.sumsqr(slacks))
        if k < p:
            d = made.add("d", n, -statement.step[k], statement.step[k])
            effort, smooth = s.weights
            f += REGULAR * cs.sumsqr(d) + effort * cs.sumsqr(d - led[:, k])
            f += smooth * cs.sumsqr(d - before - turned[:, k])
            room = steps(x, d, before, alpha[k], stages[:, max(k - 1, 0)])
            ahead = cs.vertcat(x + d, d[:kept])
            x, y = made.add("x", n, -np.inf, np.inf), made.add("y", kept, -np.inf, np.inf)
            before = y if kept else d
            made.demand("dynamics", cs.vertcat(x, y) - ahead, [0.0] * (n + kept))
            made.demand("speeds", room, [np.inf] * int(room.numel()))
        if held is not None:
            made.demand("rows", held, most)
    problem = Problem(
        x=cs.vertcat(*made.unknowns),
        names=tuple(f"{u.name()} {k}" for u in made.unknowns for k in range(u.numel())),
        lower=np.array(made.low),
        upper=np.array(made.high),
        scale=np.ones(len(made.low)),
        objective=f,
        constraints=cs.vertcat(*made.g),
        g_lower=np.zeros(len(made.g_high)),
        g_upper=np.array(made.g_high),
        given=given,
    )
    return _program(statement, made, problem)


def _program(statement: Statement, made: _Builder, problem: Problem) -> Program:
    at, n, p = made.places, statement.n, statement.settings.p
    parts = (at["d"], at["x"][1:], at["w"], at["s"], at["y"])
    sizes = (n, n, len(at["w"][0]), len(at["s"][0]), len(at["y"][0]))
    unknowns, places = (
        np.hstack([np.array(part, dtype=np.intp).reshape(p, -1) for part in every])
        for every in (parts, made.g_places.values())
    )
    charts, first = _mapped_charts(statement.shape), np.array(at["x"][0], dtype=np.intp)
    return Program(problem, charts, first, unknowns, places, sizes)


@lru_cache(maxsize=32)
def _mapped_charts(shape: StatementShape) -> cs.Function:
    return nearest_charts(shape.statement).map(shape.statement.settings.p)

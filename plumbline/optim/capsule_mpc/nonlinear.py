r"""The statement as a nonlinear program, planes and all: the reference.

The program is :mod:`.plane_program`: nothing is frozen and nothing jumps. IPOPT takes second
derivatives from the symbols, and starts from the last solution, its multipliers moved on by one
stage, with a small barrier (Waechter and Biegler 2006, sec. 3.1). FATROP sees the same unknowns as
states and controls of stages (Vanroye et al. 2023, IROS). Obstacles that are far from the last
path, and limits of the states, are left out at first; the solution is then tried on all of them,
and solved again with those that it comes too near to. What comes out satisfies the whole statement.
The program is built for the next power of two of the obstacles taken.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np

from plumbline.declared import AtLeastOne, Declared, Positive
from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.plane_program import Program, build
from plumbline.optim.capsule_mpc.planning import Plan, Ready
from plumbline.optim.capsule_mpc.statement import Statement, StatementShape
from plumbline.optim.core.problem import Array, Flags
from plumbline.optim.core.solvers import Fatrop, Ipopt, Solver
from plumbline.optim.core.solvers.programme import Programmed, compiled

Duals = tuple[Array, Array]


@dataclass(frozen=True)
class Nonlinear(Declared):
    """Options of the solver."""

    # ``"ipopt"`` or ``"fatrop"``, set up as a loop needs them; or any solver that takes bounds,
    # constraints and an objective
    solver: str | Solver = "ipopt"
    # iterations at most; two arms took 167 from a cold start, then 6 to 17
    max_iterations: AtLeastOne = 200
    # the solver's own; None for 1e-4 with IPOPT, 5e-2 with FATROP, which otherwise iterates on what
    # the penalty of slack leaves of its dual residual
    tolerance: Positive | None = None
    budget: Positive | None = None  # time that IPOPT may take [s]; None for no limit

    def ready(self, statement: Statement) -> Ready:
        """Build the programs of no obstacle and of all, some tenths of a second each."""
        for shape, limits in ((replace(statement, slots=0, balls=0).shape, False),
                              (statement.shape, True)):  # fmt: skip
            program = _built(shape, limits, isinstance(self.chosen, Fatrop))
            if isinstance(self.chosen, Programmed):
                compiled(self.chosen, program.problem)
        return _NonlinearReady(self, statement)

    @cached_property
    def chosen(self) -> Solver:
        """The solver with its options."""
        if self.solver == "fatrop":
            return Fatrop(self.max_iterations, self.tolerance or constants.FATROP_TOLERANCE)
        if self.solver == "ipopt":
            limit = () if self.budget is None else (("max_wall_time", self.budget),)
            own, tolerance = (*constants.IPOPT, *limit), self.tolerance or constants.IPOPT_TOLERANCE
            return Ipopt(self.max_iterations, tolerance, further=own, expand=True)
        if isinstance(self.solver, str):
            raise PlumblineError(f"solver: {self.solver!r} is not in this CasADi; take 'ipopt'")
        return self.solver


@dataclass(frozen=True)
class _Taken:
    """What a program holds: which obstacles, and whether the limits of the states."""

    obstacles: Flags
    limits: bool

    def more(self, other: _Taken) -> _Taken:
        return _Taken(self.obstacles | other.obstacles, self.limits or other.limits)

    def lacks(self, other: _Taken) -> bool:
        """Whether the other holds what this does not."""
        return bool((other.obstacles & ~self.obstacles).any()) or (other.limits and not self.limits)


@dataclass(frozen=True, eq=False)
class _NonlinearReady:
    options: Nonlinear
    statement: Statement
    # of the last solution, one stage on, and what it was of
    _last: list[tuple[Program, Flags, Duals]] = field(default_factory=list)
    _near: list[_Taken] = field(default_factory=list)  # near to the last solution

    def plan(self, x0: Array, stages: Array, path: Array) -> Plan:
        # What is taken at first is a guess, for which the last solution does as well as the path.
        taken = self._near[0] if self._near else self._nearer(path, stages, constants.WATCH)[0]
        for _ in range(constants.ROUNDS):
            plan = self._solved(x0, stages, path, taken)
            near, missed = self._nearer(plan.x, stages, constants.WATCH, -constants.SHORT)
            if not plan.solved or not taken.lacks(missed):
                break
            taken, path = taken.more(missed), plan.x
        self._near[:] = [near] if plan.solved else []
        return plan

    def _nearer(self, path: Array, stages: Array, *least: float) -> list[_Taken]:
        """Obstacles and limits that a path comes nearer to than so much [mm], for each."""
        own, count = self.statement, self.statement.slots + self.statement.balls
        found = _along(own.shape)(path.T, stages.T)
        gaps, limits = (value.full().min(axis=1, initial=constants.FAR) for value in found)
        fixed = np.array([pair.fixed for pair in own.pairs], dtype=bool)
        of_each = gaps[fixed].reshape(-1, count) if count else np.zeros((1, 0))
        obstacles = of_each.min(axis=0)
        return [_Taken(obstacles < most, bool((limits < most).any())) for most in least]

    def _solved(self, x0: Array, stages: Array, path: Array, taken: _Taken) -> Plan:
        own, values = self._narrowed(stages, taken.obstacles)
        solver = self.options.chosen
        program = _built(own.shape, taken.limits, isinstance(solver, Fatrop))
        low, high = program.problem.lower.copy(), program.problem.upper.copy()
        low[program.first] = high[program.first] = x0
        charts = program.charts(path.T, values.T).full()
        data = np.vstack([values.T, charts]).ravel(order="F")
        problem = replace(program.problem, lower=low, upper=high, data=data)
        start = _start(program, x0, path)
        if isinstance(solver, Programmed):
            found = solver.solve(problem, start, self._warm(program, taken.obstacles))
        else:
            found = solver.solve(problem, start)
        answer = found.x
        solved = found.success and bool(np.isfinite(answer).all())
        self._last.clear()
        if solved and found.multipliers is not None:
            self._last.append((program, taken.obstacles, program.one_on(found.multipliers)))
        short = answer[program.part(3)].max(axis=1, initial=0.0)
        slack, lasting = float(short.max()), float(short.min())
        path = answer[program.part(1)]
        return Plan(path, solved, slack, found.iterations, found.message, lasting)

    def _warm(self, program: Program, taken: Flags) -> Duals:
        """Multipliers to start from: the last ones of the same obstacles, else of free slacks."""
        for known, obstacles, duals in self._last:
            if known is program and (obstacles == taken).all():
                return duals
        bounds, rows = np.zeros(program.problem.size), np.zeros(program.problem.g_lower.size)
        bounds[program.part(3)] = -constants.MM * self.statement.settings.penalty
        return bounds, rows

    def _narrowed(self, stages: Array, taken: Flags) -> tuple[Statement, Array]:
        """The statement with the obstacles taken, and its stages' parameters."""
        whole = self.statement
        count = whole.slots + whole.balls
        capsules, balls = np.nonzero(taken[: whole.slots])[0], np.nonzero(taken[whole.slots :])[0]
        slots, ball_slots = _bucket(len(capsules), whole.slots), _bucket(len(balls), whole.balls)
        g, p = whole.goals, len(stages)
        table = stages[:, g : g + constants.OBSTACLE * count].reshape(p, count, constants.OBSTACLE)
        kept = np.zeros((p, slots + ball_slots, constants.OBSTACLE))
        kept[:, :, :6] = (
            constants.FAR / constants.MM
        )  # far, but harmless to a solver that scales by what it sees
        kept[:, : len(capsules)] = table[:, capsules]
        kept[:, slots : slots + len(balls)] = table[:, whole.slots + balls]
        rest = stages[:, g + constants.OBSTACLE * count :]
        values = np.hstack([stages[:, :g], kept.reshape(p, -1), rest])
        return replace(whole, slots=slots, balls=ball_slots), values


def _start(program: Program, x0: Array, path: Array) -> Array:
    """Unknowns to start from: a path and its steps; planes as charted, no slack."""
    start = np.zeros(program.problem.size)
    start[program.first] = x0
    start[program.part(1)] = path
    start[program.part(0)] = np.diff(path, axis=0, prepend=x0[None])
    if program.sizes[4]:
        start[program.part(4)] = start[program.part(0)]
    return start


@lru_cache(maxsize=32)
def _built(shape: StatementShape, limits: bool, stages_meet_in_states: bool) -> Program:
    return build(shape.statement, limits, stages_meet_in_states)


@lru_cache(maxsize=32)
def _along(shape: StatementShape) -> cs.Function:
    """``(path, stages) -> gaps (P, p), limits (l, p)``."""
    own = shape.statement
    x, _, stage = own.symbols
    gaps = own.clearances(x, stage)
    both = cs.Function("along", [x, stage], [gaps, cs.densify(own.limits)])
    return both.map("along", "serial", own.settings.p, [], [])


def _bucket(count: int, most: int) -> int:
    return min(1 << max(count - 1, 0).bit_length() if count else 0, most)

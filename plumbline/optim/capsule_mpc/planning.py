r"""What a planner is: a statement made ready, asked for a path at every step; two of them.

Options, state and result are three objects: options are frozen (:class:`RealTime`,
:class:`OneStep`, :class:`.nonlinear.Nonlinear`); ``ready`` builds what takes time once, for one
statement; a plan says what its solver said, and its clearance and slack are computed from the
statement, not taken from the solver.

:class:`OneStep` has no horizon: a quadratic program on control barrier functions,

.. math:: \min_{x_1} |y(x_1) - y_{ref}|^2 \quad\text{s.t.}\quad
          h_r(x_1) \ge (1 - \gamma)\, h_r(x_0), \qquad |x_1 - x_0| \le dt\, v_{max}

with h_r a pair's distance less D, linearised at x0 (Ames et al. 2017, IEEE TAC 62(8); in discrete
time Agrawal and Sreenath 2017, RSS). It lets distances shrink by a share gamma a step at most, so
it brakes before it touches; where it starts inside of the margin it asks to leave it at that rate.
The reference is one step on the straight way to the goal. It sees nothing coming, so alone it gets
stuck where the straight way ends; but it has the size of one stage, and behind the guide, which
looks at whole ways (:mod:`.waypoints`), it does as well as the horizon. It is the controller's
default.

An interior point for a chain of stages: the real-time solver.

The program is :class:`plumbline.optim.capsule_mpc.linearised.StageQp`. A row and its slack are
eliminated together, so that neither rows nor slacks enlarge the system: with slack s, its
multiplier :math:`\rho - \lambda`, and t = G x + s - h,

.. math:: w = 1 / (t / \lambda + s / (\rho - \lambda)), \qquad
          (H + A^T W A)\, \Delta x = -r_{dual} + A^T W q

Steps couple neighbouring stages group by group, so the matrix has half bandwidth b = n + s - 1 with
groups of s states, or b = 2n where changes of steps cost something, and its Cholesky factor costs
:math:`p\, n \cdot b(b + 1)/2` multiplications: nothing is condensed, and cost grows with p.
Predictor and corrector share the factor (Mehrotra 1992, SIAM J. Optim. 2(4)). The program always
has a solution: rows are soft, and standing still keeps the speed limits.

The method is written in C, ``banded_qp.c``, compiled at first use; where there is no compiler, a
solver that CasADi brings takes its place (:mod:`.library_qp`).
"""

import ctypes
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from importlib import resources
from typing import Any, Protocol

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.declared import AtLeastOne, Declared, Portion, Positive
from plumbline.optim.capsule_mpc.compiled import (
    Compiled,
    backend,
    first_line,
    library,
    say_not_compiled,
)
from plumbline.optim.capsule_mpc.constants import TOUCHING
from plumbline.optim.capsule_mpc.library_qp import LibraryQp
from plumbline.optim.capsule_mpc.linearised import Linearised, QpPath, StageQp, within_norms
from plumbline.optim.capsule_mpc.statement import Statement, StatementShape
from plumbline.optim.core.problem import Array

QUICK = ("-O3", "-funroll-loops", "-fno-math-errno", "-fno-trapping-math")


@cache
def _native() -> Any:
    source = (resources.files("plumbline.optim.capsule_mpc") / "banded_qp.c").read_text(
        encoding="utf-8"
    )
    made = library(source, "banded_qp", QUICK)
    if made is None:
        return None
    try:
        found = ctypes.CDLL(str(made))
    except OSError as error:
        say_not_compiled(first_line(error))
        return None
    found.banded_qp_space.restype = ctypes.c_long
    pointer, number = ctypes.c_void_p, ctypes.c_double
    found.banded_qp_turned.argtypes = (
        [ctypes.c_int] * 3 + [pointer] * 7 + [number] * 4 + [ctypes.c_int] + [pointer] * 7
    )
    return found


def native() -> bool:
    """Whether the compiled solver is there."""
    return _native() is not None


@dataclass(frozen=True)
class BandedQp(Declared):
    """Options of the solver."""

    max_iterations: AtLeastOne = 50  # iterations at most
    # of complementarity and stationarity [mm^2]; of the rows, a hundredth [mm]
    tolerance: Positive = 1e-3
    compiled: bool = True  # whether to use it; else, or where it is not there, a library's

    def prepare(self) -> None:
        """Compile what the first call would otherwise wait for."""
        if self.compiled:
            native()

    def solve(self, qp: StageQp, start: Array) -> QpPath:
        """Solve from a path (p, n)."""
        if not (self.compiled and native()):
            return LibraryQp().solve(qp, start)
        p, n = qp.g.shape
        rows = qp.h.shape[1]
        solver = _native()
        x = np.array(start, dtype=float)
        slack, multiplier = np.empty((p, rows)), np.empty((p, rows))
        work = np.empty(solver.banded_qp_space(p, n, p * rows))
        kept = np.empty(p + 1 + p * rows, dtype=np.int32)
        turn, group = _turned(qp)
        given = [qp.H, qp.g, qp.x0, qp.move, qp.step, qp.G, qp.h]
        arrays = [np.ascontiguousarray(a, dtype=float) for a in given]
        numbers = (qp.penalty, qp.effort, qp.smooth, self.tolerance, self.max_iterations)
        found = (x, slack, multiplier, work, kept, turn, group)
        read = (a.ctypes.data for a in arrays)
        written = (None if a is None else a.ctypes.data for a in found)
        count = solver.banded_qp_turned(p, n, rows, *read, *numbers, *written)
        return QpPath(x, slack, multiplier, count >= 0, abs(count))


def _turned(qp: StageQp) -> tuple[Array | None, NDArray[np.int32] | None]:
    """Turns, and begin and end (2, n) of every state's group."""
    if qp.turn is None:
        return None, None
    ends = np.cumsum(qp.groups)
    sizes = np.asarray(qp.groups)
    bounds = np.repeat(np.stack([ends - sizes, ends]), sizes, axis=1)
    return np.ascontiguousarray(qp.turn), np.ascontiguousarray(bounds, dtype=np.int32)


@dataclass(frozen=True)
class Plan:
    """A path over the horizon."""

    x: Array  # states (p, n) 1 to p steps ahead
    solved: bool  # whether the solver says so, and every number is finite
    slack: float  # the most by which the plan falls short of any distance or limit [mm]
    iterations: int  # of the solver
    status: str  # what the solver said
    # the least by which all of its stages fall short of some distance or limit [mm]
    lasting: float = 0.0

    def __repr__(self) -> str:
        done = "solved" if self.solved else "not solved"
        ahead = f"{len(self.x)} steps ahead"
        return f"<Plan: {ahead}, {done}, slack {self.slack:.3g} mm; {self.status[:80]}>"


class Ready(Protocol):
    """A planner that has been built for one statement."""

    def plan(self, x0: Array, stages: Array, path: Array) -> Plan:
        """Plan from x0 (n,), with the stages' parameters (p, t), about a path (p, n)."""


class Planner(Protocol):
    """Options of a planner."""

    def ready(self, statement: Statement) -> Ready:
        """Build for one statement."""


class QpSolver(Protocol):
    """A solver of the program along a chain of stages."""

    def solve(self, qp: StageQp, start: Array) -> QpPath:
        """Solve from a path (p, n)."""


@dataclass(frozen=True)
class RealTime(Declared):
    """One linearisation a step, and one quadratic program: the real-time iteration.

    Linearising once about the shifted path of the last step suffices, since the next step
    linearises anew (Diehl, Bock, Schloeder 2005, SIAM J. Control Optim. 43(5)).
    """

    # of the quadratic program: :class:`BandedQp`, or a library's
    solver: QpSolver = field(default_factory=BandedQp)
    passes: AtLeastOne = 1  # linearisations a step
    compiled: bool = True  # whether to compile the linearisation, where there is a compiler

    def ready(self, statement: Statement) -> Ready:
        """Build the linearisation; the first time, this may take a compiler some seconds."""
        linearised = Linearised(statement, self.compiled)
        linearised.prepare()
        if isinstance(self.solver, BandedQp):
            self.solver.prepare()
        return _RealTimeReady(self, linearised)


@dataclass(frozen=True, eq=False)
class _RealTimeReady:
    options: RealTime
    linearised: Linearised

    @property
    def backend(self) -> str:
        """``"compiled"`` or ``"casadi"``; a library's solver is compiled."""
        solver = self.options.solver
        own = not isinstance(solver, BandedQp) or (solver.compiled and native())
        return backend(self.linearised.native, own)

    def plan(self, x0: Array, stages: Array, path: Array) -> Plan:
        found = QpPath(path, np.zeros((1, 1)), np.zeros((1, 1)), False, 0)
        for _ in range(self.options.passes):
            qp = self.linearised.about(path, x0, stages)
            found = self.options.solver.solve(qp, path)
            if not found.solved:
                break
            path = found.x
        # Its box about the ball of the speeds has corners: the step that counts has none.
        path = found.x.copy()
        path[0] = x0 + within_norms(path[0] - x0, qp.first, qp.groups)
        each = found.slack.max(axis=1, initial=0.0)
        finite = bool(np.isfinite(path).all())
        status = "solved" if found.solved else "not converged"
        solved, slack = found.solved and finite, float(each.max())
        return Plan(path, solved, slack, found.iterations, status, float(each.min()))


def shifted(path: Array) -> Array:
    """The rest of a path (p, n) one step later, its last state held."""
    return np.concatenate([path[1:], path[-1:]])


@dataclass(frozen=True)
class OneStep(Declared):
    """Options of one step."""

    # share of its distance that a pair may lose in a step
    gamma: Portion = 0.3
    compiled: bool = True  # whether to compile, where there is a compiler

    def ready(self, statement: Statement) -> Ready:
        """Build for one statement."""
        plain = replace(statement.settings, p=1, effort=0.0, smooth=0.0)
        one = replace(statement, settings=plain)
        linearised = Linearised(one, self.compiled)
        linearised.prepare()
        BandedQp().prepare()
        return _OneStepReady(
            self, statement, linearised, Compiled(tracked_function(one.shape), False)
        )


@lru_cache(maxsize=32)
def tracked_function(shape: StatementShape) -> cs.Function:
    """``(x, stage) -> (g,)``: what is compared with the goals [mm]."""
    x, _, stage = shape.statement.symbols
    return cs.Function("tracked", [x, stage], [cs.densify(shape.statement.tracked)])


@dataclass(frozen=True, eq=False)
class _OneStepReady:
    options: OneStep
    statement: Statement
    linearised: Linearised
    tracked: Compiled

    @property
    def backend(self) -> str:
        """``"compiled"`` or ``"casadi"``."""
        return backend(self.linearised.native, native())

    def plan(self, x0: Array, stages: Array, path: Array) -> Plan:
        """The same step held for the rest of the horizon."""
        gamma, goals = self.options.gamma, self.statement.goals
        first = stages[:1].copy()
        here = self.tracked(x0, stages[0])[0]
        way = first[0, :goals] - here
        most = float(self.linearised.statement.step.max())
        points = way.reshape(-1, 3) if goals % 3 == 0 else way[:, None]
        far = float(np.linalg.norm(points, axis=1).max())
        first[0, :goals] = here + way * min(1.0, most / max(far, TOUCHING))
        # A row may matter while its value is below what a step changes, over gamma.
        first[:, -self.statement.n :] /= gamma
        qp = self.linearised.about(x0[None], x0, first)
        decayed = np.where(qp.present, (1 - gamma) * (qp.G @ x0) + gamma * qp.h, qp.h)
        found = BandedQp().solve(replace(qp, h=decayed), x0[None])
        slack = float(found.slack.max(initial=0.0))
        step = within_norms(found.x[0] - x0, qp.first, qp.groups)
        ahead = np.tile(x0 + step, (len(stages), 1))
        solved = found.solved and bool(np.isfinite(found.x).all())
        status = "one step" if solved else "one step: not converged"
        return Plan(ahead, solved, slack, found.iterations, status, slack)

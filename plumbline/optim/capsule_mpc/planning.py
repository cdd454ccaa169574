"""What a planner is: a statement made ready, asked for a path at every step.

Options, state and result are three objects: options are frozen (:class:`RealTime`,
:class:`.nonlinear.Nonlinear`, :class:`.one_step.OneStep`); ``ready`` builds what takes time once,
for one statement; a plan says what its solver said, and its clearance and slack are computed from
the statement, not taken from the solver.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.capsule_mpc.banded_qp import BandedQp, native
from plumbline.optim.capsule_mpc.compiled import backend
from plumbline.optim.capsule_mpc.linearised import Linearised, QpPath, StageQp, within_norms
from plumbline.optim.capsule_mpc.statement import Statement

Array = NDArray[np.float64]


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
        """How far ahead, and what the solver said."""
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
class RealTime:
    """One linearisation a step, and one quadratic program: the real-time iteration.

    Linearising once about the shifted path of the last step suffices, since the next step
    linearises anew (Diehl, Bock, Schloeder 2005, SIAM J. Control Optim. 43(5)).
    """

    # of the quadratic program: :class:`.banded_qp.BandedQp`, or a library's
    solver: QpSolver = field(default_factory=BandedQp)
    passes: int = 1  # linearisations a step
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

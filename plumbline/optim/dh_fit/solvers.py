"""What solves the bounded fit; the choice is made at the call, never in the statement.

All start at the nominal robot and stay within the bounds; all reach the same optimum. Trust region
and Levenberg-Marquardt are the least-squares solvers of :mod:`plumbline.optim.core.solvers`: they
are given the residual of which half the square is the loss.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from plumbline.optim.core.solvers import LevenbergMarquardt, TrustRegion
from plumbline.optim.dh_fit.gauss_newton import Array, Found, GaussNewton
from plumbline.optim.dh_fit.losses import Norms
from plumbline.optim.dh_fit.nonlinear import Ipopt, Sqp
from plumbline.optim.dh_fit.statement import Readings, Statement
from plumbline.optim.dh_fit.sums import Pass


class DHSolver(Protocol):
    """A frozen dataclass of typed options."""

    @property
    def name(self) -> str:
        """What it is called on the command line."""

    def solve(self, statement: Statement, readings: Readings, start: Array) -> Found:
        """Solve from a start (P,), clipped into the bounds."""


@dataclass(frozen=True)
class LeastSquares:
    """A least-squares solver on the residual whose square is the loss.

    Attributes:
        solver: The solver.
        name: What it is called on the command line.
    """

    solver: TrustRegion | LevenbergMarquardt
    name: str

    def solve(self, statement: Statement, readings: Readings, start: Array) -> Found:
        """Solve from a start (P,), clipped into the bounds."""
        found = self.solver.solve(statement.problem(readings), start)
        return Found(found.x, found.iterations, found.message)


@dataclass(frozen=True)
class Narrowing:
    """A solver that is led to the corner of the norms.

    With norms the corner at zero is narrowed in steps, from the misfits' own size to the smoothing
    that was asked for: a quadratic model of a corner is good only close by. Squares have none.

    Attributes:
        solver: What solves each step, from the optimum of the one before.
        factor: Factor between two smoothings.
    """

    solver: DHSolver
    factor: float = 30.0

    @property
    def name(self) -> str:
        """What it is called on the command line."""
        return self.solver.name

    def solve(self, statement: Statement, readings: Readings, start: Array) -> Found:
        """Solve from a start (P,), clipped into the bounds."""
        x, spent, message = np.clip(start, statement.lower, statement.upper), 0, ""
        for stated in self._stages(statement, readings, x):
            found = self.solver.solve(stated, readings, x)
            x, spent, message = found.x, spent + found.iterations, found.message
        return Found(x, spent, message)

    def _stages(self, statement: Statement, readings: Readings, x: Array) -> list[Statement]:
        loss = statement.loss
        if not isinstance(loss, Norms):
            return [statement]
        misfits = np.linalg.norm(Pass(statement, readings).misfits(x), axis=1)
        wide, stages = 3.0 * float(misfits.max()), [statement]
        steps = int(np.ceil(np.log(max(wide / loss.smoothing, 1.0)) / np.log(self.factor)))
        for k in range(1, steps + 1):
            wider = Norms(min(loss.smoothing * self.factor**k, wide))
            stages.insert(0, replace(statement, loss=wider))
        return stages


SOLVERS: tuple[DHSolver, ...] = (
    GaussNewton(),
    Narrowing(Sqp()),
    Narrowing(Sqp(bfgs=True, name="sqp-bfgs")),
    Narrowing(Ipopt()),
    Narrowing(LeastSquares(TrustRegion(2000, 1e-13), "trust-region")),
    Narrowing(LeastSquares(LevenbergMarquardt(2000, 1e-13), "levenberg-marquardt")),
)
BY_NAME = {solver.name: solver for solver in SOLVERS}

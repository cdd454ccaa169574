"""What solves the bounded fit; the choice is made at the call, never in the statement.

Gauss-Newton knows what a problem of links is made of; the others are given the residual of which
half the square is the loss, as any solver of :mod:`plumbline.optim.core.solvers` may be. All start
at the nominal robot and stay within the bounds; all reach the same optimum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from plumbline.optim.core.problem import Problem
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers import Ipopt, LevenbergMarquardt, Solver, Sqp, TrustRegion
from plumbline.optim.core.stored import register_kinds
from plumbline.optim.dh_fit.constants import FACTOR
from plumbline.optim.dh_fit.gauss_newton import Array, GaussNewton, of_links
from plumbline.optim.dh_fit.losses import Loss, Norms, Squares
from plumbline.optim.dh_fit.statement import Readings, Statement
from plumbline.optim.dh_fit.sums import Pass


@dataclass(frozen=True)
class Narrowing:
    """A solver that is led to the corner of the norms.

    With norms the corner at zero is narrowed in steps, from the misfits' own size to the smoothing
    that was asked for: a quadratic model of a corner is good only close by. Squares have none.
    """

    name: str  # what it is called on the command line
    solver: Solver  # what solves each step, from the optimum of the one before
    rounds: int = 1  # how often it solves the last: tolerances speak of the start's objective

    bounds: ClassVar[bool] = True
    constraints: ClassVar[bool] = False
    objective: ClassVar[bool] = False
    rows: ClassVar[bool] = True

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve a problem of links from a start (P,), clipped into the bounds.

        Raises:
            PlumblineError: It is another problem.
        """
        own = of_links(problem, "Narrowing")
        x, spent = np.clip(np.asarray(start, dtype=float), problem.lower, problem.upper), 0
        wider = [stated.problem(own.readings) for stated in _stages(own.statement, own.readings, x)]
        for stage in (*wider, *([problem] * self.rounds)):
            found = self.solver.solve(stage, x)
            x, spent = found.x, spent + found.iterations
        return replace(found, iterations=spent)


def _stages(statement: Statement, readings: Readings, x: Array) -> list[Statement]:
    loss = statement.loss
    if not isinstance(loss, Norms):
        return []
    misfits = np.linalg.norm(Pass(statement, readings).misfits(x), axis=1)
    wide = 3.0 * float(misfits.max())
    steps = int(np.ceil(np.log(max(wide / loss.smoothing, 1.0)) / np.log(FACTOR)))
    widths = [min(loss.smoothing * FACTOR**k, wide) for k in range(steps, 0, -1)]
    return [replace(statement, loss=Norms(width)) for width in widths]


# At a corner of the norms rounding hides descent long before slopes vanish.
CORNERED = (
    ("acceptable_tol", 1e-3),
    ("acceptable_compl_inf_tol", 1e-10),
    ("acceptable_obj_change_tol", 1e-12),
    ("mu_strategy", "adaptive"),
)
SOLVERS: tuple[GaussNewton | Narrowing, ...] = (
    GaussNewton(),
    Narrowing("sqp", Sqp()),
    Narrowing("sqp-bfgs", Sqp(bfgs=True)),
    Narrowing("ipopt", Ipopt(300, 1e-10, further=CORNERED), rounds=2),
    Narrowing("trust-region", TrustRegion(2000, 1e-13)),
    Narrowing("levenberg-marquardt", LevenbergMarquardt(2000, 1e-13)),
)
BY_NAME = {solver.name: solver for solver in SOLVERS}
register_kinds(Loss, Norms, Squares)
register_kinds(Solver, GaussNewton, Narrowing)

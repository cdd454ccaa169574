r"""What solves the bounded fit; the choice is made at the call, never in the statement.

Gauss-Newton is Levenberg and Marquardt's on the sums of a problem of links: its matrix is that of
the loss itself, and the camera's frame is worked out once. The others are given the residual of
which half the square is the loss, as any solver of :mod:`plumbline.optim.core.solvers` may be. All
start at the nominal robot and stay within the bounds; all reach the same optimum.
"""

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import Count, NotNegative
from plumbline.errors import PlumblineError
from plumbline.optim.core.answer import register_kinds
from plumbline.optim.core.constants import LEAST_DAMPING
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.core.solvers import Ipopt, LevenbergMarquardt, Solver, Sqp, TrustRegion
from plumbline.optim.core.solvers.levenberg_marquardt import damped_step, promised
from plumbline.optim.core.solvers.solver import OfRows
from plumbline.optim.dh_fit.constants import FACTOR, FEW
from plumbline.optim.dh_fit.losses import Loss, Norms, Squares
from plumbline.optim.dh_fit.statement import DHStatement, LinkProblem, Pass, Readings
from plumbline.optim.rigid import some_of


@dataclass(frozen=True)
class GaussNewton(LevenbergMarquardt):
    """Options of the solver of a problem of links."""

    max_iterations: Count = 300  #: steps tried at most
    tolerance: NotNegative = 1e-14  #: relative drop of the loss below which it stops

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve a problem of links from a start (P,), clipped into the bounds."""
        own = of_links(problem, "GaussNewton")
        found = self.on(Pass(own.statement, own.readings), start)
        return Solution(problem, found.x, found.iterations, found.message)


def of_links(problem: Problem, asker: str = "a fit of links") -> LinkProblem:
    """The problem, refused if it does not know what it was made of."""
    if not isinstance(problem, LinkProblem):
        found = type(problem).__name__
        raise PlumblineError(
            f"{asker}: {found} found, LinkProblem expected; use LevenbergMarquardt"
        )
    return problem


def promised_drop(statement: DHStatement, readings: Readings, x: Array) -> float:
    """What one more step from x (P,) promises to take off the objective [m or m^2]."""
    if not statement.size:
        return 0.0
    rows = Pass(statement, readings)
    gram = rows.gram(x)
    return promised(gram, damped_step(rows.problem, gram, x, LEAST_DAMPING) - x) / 2.0


@dataclass(frozen=True)
class Narrowing(OfRows):
    """A solver that is led to the corner of the norms.

    With norms the corner at zero is narrowed in steps, from the misfits' own size to the smoothing
    that was asked for: a quadratic model of a corner is good only close by. Squares have none.
    """

    name: str  # what it is called on the command line
    solver: Solver  # what solves each step, from the optimum of the one before
    rounds: Count = 1  # how often it solves the last: tolerances speak of the start's objective

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve a problem of links from a start (P,), clipped into the bounds."""
        own = of_links(problem, "Narrowing")
        x, spent = np.clip(np.asarray(start, dtype=float), problem.lower, problem.upper), 0
        some = own.readings.select(some_of(len(own.readings), FEW))
        wider = [stated.problem(some) for stated in _stages(own.statement, some, x)]
        for stage in (*wider, *([problem] * self.rounds)):
            found = self.solver.solve(stage, x)
            x, spent = found.x, spent + found.iterations
        return replace(found, iterations=spent)


def _stages(statement: DHStatement, readings: Readings, x: Array) -> list[DHStatement]:
    loss = statement.loss
    if not isinstance(loss, Norms):
        return []
    misfits = np.linalg.norm(Pass(statement, readings).misfits(x), axis=1)
    wide = 3.0 * float(misfits.max())
    steps = int(np.ceil(np.log(max(wide / loss.smoothing, 1.0)) / np.log(FACTOR)))
    return [
        _with_loss(statement, Norms(min(loss.smoothing * FACTOR**k, wide)))
        for k in range(steps, 0, -1)
    ]


def _with_loss(statement: DHStatement, loss: Loss) -> DHStatement:
    """The same with another loss, and the functions that it has compiled."""
    other = copy(statement)
    vars(other)["loss"] = loss
    return other


# At a corner of the norms rounding hides descent long before slopes vanish.
CORNERED = (
    ("acceptable_tol", 1e-3),
    ("acceptable_compl_inf_tol", 1e-10),
    ("acceptable_obj_change_tol", 1e-12),
    ("mu_strategy", "adaptive"),
)
SOLVERS = (
    Narrowing("gauss-newton", GaussNewton()),
    Narrowing("sqp", Sqp()),
    Narrowing("sqp-bfgs", Sqp(bfgs=True)),
    Narrowing("ipopt", Ipopt(300, 1e-10, further=CORNERED), rounds=2),
    Narrowing("trust-region", TrustRegion(2000, 1e-13)),
    Narrowing("levenberg-marquardt", LevenbergMarquardt(2000, 1e-13)),
)
BY_NAME = {solver.name: solver for solver in SOLVERS}
register_kinds(Loss, Norms, Squares)
register_kinds(Solver, GaussNewton, Narrowing)

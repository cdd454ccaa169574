r"""What solves the bounded fit; the choice is made at the call, never in the statement.

Gauss-Newton knows what a problem of links is made of; the others are given the residual of which
half the square is the loss, as any solver of :mod:`plumbline.optim.core.solvers` may be. All start
at the nominal robot and stay within the bounds; all reach the same optimum. Gauss-Newton is
sequential quadratic programming with the generalised Gauss-Newton matrix,

.. math:: \min_p\ g^T p + \tfrac12 p^T (B + \mu D) p \quad\text{s.t.}\quad l \le x + p \le u,
          \qquad D = \mathrm{diag}(B)

The bounded quadratic programme is solved by an active set that both drops and takes back unknowns
(Bertsekas 1982, SIAM J. Control Optim. 20(2)); mu makes every accepted step a descent (Madsen,
Nielsen, Tingleff 2004, algorithm 3.16). Where redundant links meet bounds or a poor model, B alone
crawls; close to the optimum the step with the whole Hessian is tried first, if there are few
readings or B has failed, and kept where it descends as it promises. With many readings the first
steps are made on some of them: close to the optimum two or three passes over all are enough.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import Count, NotNegative
from plumbline.errors import PlumblineError
from plumbline.optim.core.answer import register_kinds
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.core.solvers import Ipopt, LevenbergMarquardt, Solver, Sqp, TrustRegion
from plumbline.optim.core.solvers.solver import OfRows
from plumbline.optim.dh_fit import constants
from plumbline.optim.dh_fit.losses import Loss, Norms, Squares
from plumbline.optim.dh_fit.statement import DHStatement, LinkProblem, Pass, Readings, Sums


@dataclass(frozen=True)
class GaussNewton(OfRows):
    """Options of the solver."""

    max_iterations: Count = 300  # steps tried at most
    # relative drop of the objective that a full step promises, below which it stops
    tolerance: NotNegative = 1e-12
    damping: NotNegative = 1e-4  # first mu
    few: Count = 2000  # readings that the first steps are made on, if there are many more
    name: str = "gauss-newton"

    def solve(self, problem: Problem, start: ArrayLike) -> Solution:
        """Solve a problem of links from a start (P,), clipped into the bounds."""
        own = of_links(problem, "GaussNewton")
        statement, readings = own.statement, own.readings
        first = np.asarray(start, dtype=float)
        x, spent = np.clip(first, statement.lower, statement.upper), 0
        passes = [Pass(statement, readings)]
        if len(readings) > 4 * self.few:
            some = np.linspace(0, len(readings) - 1, self.few).astype(int)
            passes.insert(0, Pass(statement, readings.select(some)))
        if isinstance(statement.loss, Norms):
            x, spent, _ = self._descend(replace(passes[0], other=Squares()), x, constants.ROUGH)
            x, more = self._soften(passes[0], x, statement.loss.smoothing)
            spent += more
        message = ""
        for rows in passes:
            x, more, message = self._descend(rows, x, self.tolerance)
            spent += more
        return Solution(problem, x, spent, message)

    def _soften(self, rows: Pass, x: Array, smoothing: float) -> tuple[Array, int]:
        """First fits of norms whose corner is as wide as the misfits are, then narrower."""
        wide, spent = float(np.median(np.linalg.norm(rows.misfits(x), axis=1))), 0
        while wide > constants.NARROWING * smoothing:
            x, more, _ = self._descend(replace(rows, other=Norms(wide)), x, constants.ROUGH)
            wide, spent = wide / constants.NARROWING, spent + more
        return x, spent

    def _descend(self, rows: Pass, x: Array, tolerance: float) -> tuple[Array, int, str]:
        stated = rows.statement
        S, lower, upper = stated.scale, stated.lower, stated.upper
        here, mu, curved = rows.sums(x), self.damping, len(rows.readings) <= self.few
        rest = 0
        for step in range(1, self.max_iterations + 1):
            box = ((lower - x) / S, (upper - x) / S)
            p, promised = _bounded_step(here, S, *box, mu)
            if promised <= tolerance * max(here.objective, 1e-300):
                # A hasty active set may promise too little: asked once more, to the end.
                p, promised = _bounded_step(here, S, *box, mu, rounds=4 * stated.size)
                if promised <= tolerance * max(here.objective, 1e-300):
                    return x, step, "converged"
            if curved and step >= rest and promised <= constants.NEAR * here.objective:
                better = _newton(rows, x, here, box)
                if better is not None:
                    x, here = better
                    continue
                rest = step + constants.PATIENCE
            trial = np.clip(x + S * p, lower, upper)
            there = rows.sums(trial)
            gain = (here.objective - there.objective) / promised
            if not gain > 0.0:
                mu, curved = max(constants.EASED * mu, constants.FIRST_AGAIN), True
                if mu > constants.HOPELESS:
                    return x, step, "no further descent"
                continue
            x, here = trial, there
            if gain > constants.WELL:
                mu = max(mu / constants.EASED, constants.LEAST_DAMPING)
            elif not gain > constants.POORLY:
                mu = constants.DEARER * mu
        return x, self.max_iterations, "iteration limit reached"


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
    S, here = statement.scale, Pass(statement, readings).sums(x)
    box = ((statement.lower - x) / S, (statement.upper - x) / S)
    return _bounded_step(here, S, *box, constants.LEAST_DAMPING, rounds=4 * statement.size)[1]


def _newton(
    rows: Pass, x: Array, here: Sums, box: tuple[Array, Array]
) -> tuple[Array, Sums] | None:
    """A step with the whole Hessian; None where it does not descend as it promises."""
    stated = rows.statement
    whole = Sums(here.objective, here.gradient, here.matrix + rows.curving(x))
    try:
        p, promised = _bounded_step(whole, stated.scale, *box, constants.NEWTON_DAMPING)
    except np.linalg.LinAlgError:
        return None
    if not promised > 0.0:
        return None
    trial = np.clip(x + stated.scale * p, stated.lower, stated.upper)
    there = rows.sums(trial)
    descends = here.objective - there.objective > constants.DESCENDS * promised
    return (trial, there) if descends else None


def _bounded_step(
    here: Sums, scale: Array, low: Array, high: Array, mu: float, rounds: int = constants.QUICK
) -> tuple[Array, float]:
    """The damped step (P,) in units of the scales, and the drop of the objective it promises."""
    B, g = here.matrix * np.outer(scale, scale), here.gradient * scale
    diagonal = np.maximum(np.diag(B), constants.FLOOR * max(np.diag(B).max(initial=0.0), 1e-300))
    A = B + mu * np.diag(diagonal)
    p = np.zeros(len(g))
    held = ((low >= 0.0) & (g > 0.0)) | ((high <= 0.0) & (g < 0.0))
    for _ in range(rounds):
        free = ~held
        p = np.where(held, np.clip(p, low, high), 0.0)
        p[free] = np.linalg.solve(A[np.ix_(free, free)], -(g + A[:, held] @ p[held])[free])
        out = free & ((p < low) | (p > high))
        if out.any():
            p = np.clip(p, low, high)
            held |= out
            continue
        if not held.any():
            break
        slope = g + A @ p
        back = held & (((p <= low) & (slope < 0.0)) | ((p >= high) & (slope > 0.0)))
        if not back.any():
            break
        # One at a time, the one that pulls hardest: several at once may cycle.
        held[np.argmax(np.where(back, np.abs(slope) / np.sqrt(diagonal), -1.0))] = False
    return p, float(-(g @ p + 0.5 * p @ B @ p))


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
        wider = [stated.problem(own.readings) for stated in _stages(own.statement, own.readings, x)]
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
    steps = int(np.ceil(np.log(max(wide / loss.smoothing, 1.0)) / np.log(constants.FACTOR)))
    widths = [min(loss.smoothing * constants.FACTOR**k, wide) for k in range(steps, 0, -1)]
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

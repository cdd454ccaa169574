r"""Whether a fit ended where it should: judged from the problem at its end, not by the solver.

About a point with residuals r and Jacobian J, over the unknowns that no bound holds back,

.. math:: \lambda = \frac{\sqrt{g^T H^{+} g}}{s}, \qquad g = J^T r,\ H = J^T J,\
          s^2 = \frac{r^T r}{n - \operatorname{rank} H}

is by how many of its standard errors the combination of unknowns that is farthest from its place
would still move (Newton's decrement: Boyd and Vandenberghe 2004, sec. 9.5.1; Gauss and Newton's
curvature). Correlated unknowns are judged together, where one at a time promises next to nothing.

Where more than squares is to be made least there is no such unit. With the Lagrangian
:math:`L = f + \lambda \cdot g` and P the projection onto bounds, a point is stationary, feasible
and complementary if and only if both of

.. math:: \| z - P_z (z - \nabla_z L) \|_\infty, \qquad \| g - P_g (g + \lambda) \|_\infty

are zero, z being the unknowns over their scales (the natural residual of the conditions of Karush,
Kuhn and Tucker: Facchinei and Pang 2003, sec. 1.5.2). Any multipliers may be offered for this: that
some pass is the proof.

A solution judges itself: nothing of its quality is taken from the solver.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
import scipy

from plumbline.optim.core import constants
from plumbline.optim.core.mapped import Gram, Mapped
from plumbline.optim.core.problem import Array, Flags, Problem


@dataclass(frozen=True, eq=False)
class Solution:
    """A point, and how good it is by the problem's own statement."""

    problem: Problem  #: what was to be solved
    x: Array  #: the point (P,)
    iterations: int = 0  #: how many steps the solver took
    message: str = ""  #: what the solver says, in words; never used to judge
    #: of bounds (P,) and constraints (c,), where the solver has them: above 0 where an upper bound
    #: presses. They may be offered as proof, and to start from.
    multipliers: tuple[Array, Array] | None = None
    #: whether the solver says that it stopped of its own accord; never used to judge
    success: bool = True

    def __repr__(self) -> str:
        steps = f"{self.problem.size} unknowns after {self.iterations} steps"
        return f"<Solution: {steps}; {self.message[:80] or 'nothing said'}>"

    @property
    def by_name(self) -> dict[str, float]:
        """The point's values by their names."""
        return dict(zip(self.problem.names, self.x.tolist(), strict=True))

    @cached_property
    def mapped(self) -> Mapped:
        """The problem's functions."""
        return Mapped(self.problem)

    @cached_property
    def gram(self) -> Gram:
        """Normal equations at the point."""
        return self.mapped.gram(self.x)

    def judged_by(self, gram: Gram) -> Self:
        """The same, by normal equations at the point that have been worked out already."""
        vars(self)["gram"] = gram
        return self

    @property
    def cost(self) -> float:
        """What is to be least, at the point."""
        return self.gram.square / 2 + self.mapped.objective(self.x)[0]

    @cached_property
    def gradient(self) -> Array:
        """Gradient (P,) of the cost."""
        return self.gram.vector + self.mapped.objective(self.x)[1]

    def primal_violation(self) -> float:
        """Largest violation of a bound or constraint, in the unknowns' own units."""
        p = self.problem
        gaps = [p.lower - self.x, self.x - p.upper]
        if p.constraints.numel():
            g = self.mapped.constraints(self.x)
            gaps += [p.g_lower - g, g - p.g_upper]
        return float(max(0.0, np.concatenate(gaps).max(initial=0.0)))

    def stationarity(self) -> float:
        """Largest drop of cost, relative to it, that a step along one unknown alone promises.

        The step is that of Gauss and Newton, cut at the unknown's bounds: pushing against a bound
        counts for nothing. Active constraints hold against the gradient as well as they can.
        """
        p = self.problem
        gradient = (self.gradient - self.held_by_constraints()) * p.scale
        curvature = np.diag(self.gram.matrix + self.mapped.bend(self.x)) * p.scale**2
        floor = max(constants.LEAST_DIAGONAL * curvature.max(initial=0.0), np.finfo(float).tiny)
        curvature = np.maximum(curvature, floor)
        back, ahead = np.minimum(p.lower - self.x, 0.0), np.maximum(p.upper - self.x, 0.0)
        step = np.clip(-gradient / curvature, back / p.scale, ahead / p.scale)
        drop = -step * (gradient + curvature * step / 2)
        return float(drop.max(initial=0.0) / max(abs(self.cost), np.finfo(float).tiny))

    def held_by_constraints(self) -> Array:
        """The part (P,) of the gradient that active constraints balance; they only push."""
        p = self.problem
        if not p.constraints.numel():
            return np.zeros(p.size)
        g, A = self.mapped.constraints(self.x), self.mapped.slopes(self.x)
        near = constants.NEAR * (1 + np.abs(g))
        low, high = g - p.g_lower <= near, p.g_upper - g <= near
        pushes = np.concatenate([A[low], -A[high]])
        free = ~self._resting()
        if not len(pushes) or not free.any():
            return np.zeros(p.size)
        sizes = p.scale[free]
        strength, _ = scipy.optimize.nnls((pushes[:, free] * sizes).T, self.gradient[free] * sizes)
        return pushes.T @ strength

    def _resting(self) -> Flags:
        """Which unknowns (P,) are within a millionth of their scale of a bound."""
        p = self.problem
        room = constants.NEAR * p.scale
        return (self.x <= p.lower + room) | (self.x >= p.upper - room)

    def is_optimal(self, eps: float = 1e-8) -> bool:
        """Whether both residuals of optimality, recomputed here, are below eps."""
        return self.primal_violation() <= eps and self.stationarity() <= eps

    def at_bound(self) -> tuple[str, ...]:
        """Names of the unknowns that rest on a bound."""
        names = zip(self.problem.names, self._resting(), strict=True)
        return tuple(name for name, resting in names if resting)

    def std(self, sigma: float) -> Array:
        """Standard errors (P,) at a noise of sigma [the residual's unit]; inf if unobservable."""
        return standard_errors(self.gram.matrix, sigma)


def standard_errors(matrix: Array, sigma: float, least: float = constants.NO_CURVATURE) -> Array:
    """Standard errors (P,) that normal equations (P, P) give at a noise of sigma.

    Infinite where a direction, scaled, has no more than the ``least`` curvature times P.
    """
    diagonal = np.diag(matrix)
    S = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(matrix * np.outer(S, S))
    small = values <= least * max(len(S), 1)
    inverse = np.where(small, 0.0, 1 / np.where(small, 1.0, values))
    variance = (vectors**2) @ inverse
    lost = (vectors[:, small] ** 2).sum(axis=1) > constants.LOST
    return np.where(lost, np.inf, sigma * S * np.sqrt(variance))


def root_of(C: Array) -> Array:
    """W (..., k, k), symmetric, with ``W W = C``: of covariances that may be singular."""
    values, vectors = np.linalg.eigh(C)
    sizes = np.sqrt(np.maximum(values, 0.0))[..., None, :]
    return np.asarray((vectors * sizes) @ np.swapaxes(vectors, -1, -2))


LONG = re.compile(r"\d+\.\d{5,}")  # a number that was computed


@dataclass(frozen=True)
class Judged:
    """How a fit ended."""

    fit: str  # what was fitted, in words that a sentence may start with
    converged: bool  # whether nothing moves any more, inside all bounds and constraints
    # by how many standard errors the unknowns would still move; NaN where the point is no number
    stationarity: float
    violation: float = 0.0  # largest violation of a bound or constraint, in the unknowns' own units
    # names of the unknowns that rest on a bound: they may belong beyond it
    at_bound: tuple[str, ...] = ()
    limit: float = constants.STILL  # of the stationarity
    unit: ClassVar[str] = "standard errors"  # of the stationarity, which a kind of judgement has

    def __repr__(self) -> str:
        return f"<Judged: {self.words}>"

    @property
    def words(self) -> str:
        """One line: that it converged, or what is wrong, the limit and the way out."""
        # Names tell variants to the last digit, which nobody reads.
        bounds = (
            LONG.sub(lambda n: f"{float(n[0]):.4g}", b) for b in self.at_bound[: constants.LISTED]
        )
        named = ", ".join(bounds) + ", ..." * (len(self.at_bound) > constants.LISTED)
        rests = f"; at a bound: {named}" if named else ""
        if self.converged:
            return f"{self.fit} converged ({self.stationarity:.1g} {self.unit} to go){rests}"
        found = f"its unknowns would still move by {self.stationarity:.2g} {self.unit}"
        limit, mend = f"{self.limit:.2g}", "allow more iterations"
        if not np.isfinite(self.stationarity):
            found, limit, mend = "it ended at no finite point", "", "start nearer"
        elif self.violation > constants.FEASIBLE:
            found, limit = f"it breaks a bound by {self.violation:.2g}", f"{constants.FEASIBLE:g}"
        said = f"{found}, {limit} allowed" if limit else found
        return f"{self.fit} has not converged: {said}; {mend}{rests}"


@dataclass(frozen=True, repr=False)
class JudgedByResidual(Judged):
    """The same by the natural residual, where more than squares is to be made least."""

    limit: float = constants.STATIONARY
    unit: ClassVar[str] = "of their scales"


@dataclass(frozen=True)
class Judgement:
    """Every fit behind an answer."""

    converged: bool = True  # whether all of them converged
    fits: tuple[Judged, ...] = ()  # each one; of many alike the worst

    def __repr__(self) -> str:
        return f"<Judgement: {len(self.fits) - len(self.failures)} of {len(self.fits)} converged>"

    @classmethod
    def of(cls, fits: Iterable[Judged]) -> Self:
        """All of them together."""
        every = tuple(fits)
        return cls(all(one.converged for one in every), every)

    @property
    def failures(self) -> tuple[str, ...]:
        """One line for every fit that has not converged."""
        return tuple(one.words for one in self.fits if not one.converged)


def judged(solution: Solution, fit: str = "the fit") -> Judged:
    """Judge where a solver ended, by the problem's own statement; ``fit`` begins the sentence."""
    by_residual = solution.problem.has_objective
    if not np.isfinite(solution.x).all():
        return (JudgedByResidual if by_residual else Judged)(fit, False, float("nan"))
    if by_residual:
        return _by_natural_residual(solution, fit)
    gradient = solution.gram.vector - solution.held_by_constraints()
    moves = decrement(solution.gram, gradient, _free(solution, gradient))
    return _judged(fit, moves, solution.primal_violation(), solution.at_bound())


def _by_natural_residual(solution: Solution, fit: str) -> JudgedByResidual:
    p = solution.problem
    if solution.multipliers is None:
        slope, pressed = solution.gradient - solution.held_by_constraints(), 0.0
    else:
        forces = solution.multipliers[1]
        slope, g = solution.mapped.lagrangian(solution.x, forces)
        pressed = float(np.abs(g - np.clip(g + forces, p.g_lower, p.g_upper)).max(initial=0.0))
    z, low, high = (value / p.scale for value in (solution.x, p.lower, p.upper))
    away = float(np.abs(z - np.clip(z - slope * p.scale, low, high)).max(initial=0.0))
    moves, violation = max(away, pressed), solution.primal_violation()
    good = moves <= constants.STATIONARY and violation <= constants.FEASIBLE
    return JudgedByResidual(fit, good, moves, violation, solution.at_bound())


def judged_by_gram(gram: Gram, fit: str = "the fit", limit: float = constants.STILL) -> Judged:
    """Judge a point without bounds by its normal equations, the weights and priors included.

    ``fit`` begins the sentence; ``limit`` is how many standard errors it may still move.
    """
    every = np.ones(len(gram.vector), dtype=bool)
    return _judged(fit, decrement(gram, gram.vector, every), 0.0, (), limit)


def the_worst(found: Iterable[Judged]) -> Judged | None:
    """The one that is farthest from its end; None of none."""
    far = [(not one.converged, np.nan_to_num(one.stationarity, nan=np.inf), one) for one in found]
    return max(far, key=lambda each: each[:2])[2] if far else None


def _judged(
    fit: str,
    moves: float,
    violation: float,
    at_bound: tuple[str, ...],
    limit: float = constants.STILL,
) -> Judged:
    good = moves <= limit and violation <= constants.FEASIBLE
    return Judged(fit, good, moves, violation, at_bound, limit)


def decrement(gram: Gram, gradient: Array, free: Flags) -> float:
    """By how many standard errors the free unknowns (P,) would still move; NaN if no number."""
    if not (np.isfinite(gram.square) and np.isfinite(gradient).all()):
        return float("nan")
    matrix, vector = gram.matrix[np.ix_(free, free)], gradient[free]
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    values, vectors = np.linalg.eigh(matrix * np.outer(unit, unit))
    told = values > constants.SINGULAR * max(values.max(initial=0.0), 1e-300)
    along = vectors[:, told].T @ (vector * unit)
    freedom = max(gram.count - int(told.sum()), 1.0)
    variance = max(gram.square / freedom, constants.LEAST_RESIDUAL**2)
    return float(np.sqrt(np.sum(along**2 / values[told]) / variance))


def _free(solution: Solution, gradient: Array) -> Flags:
    """Unknowns (P,) that may still move: not held, nor pushed against a bound that they rest on."""
    p = solution.problem
    room = constants.NEAR * p.scale
    low, high = solution.x <= p.lower + room, solution.x >= p.upper - room
    held = p.lower >= p.upper
    return ~(held | (low & (gradient > 0.0)) | (high & (gradient < 0.0)))

r"""From readings to an answer: the beam, how well it is known, and what to distrust.

1. A robust start from any direction (:mod:`.start`): readings beyond so many robust sigmas are
   gross errors.
2. Variances over incidence and bowed boards by largest likelihood (:mod:`.reweighting`); readings
   that are gross about that fit leave too.
3. The solver of the caller's choice on the statement with its weights fixed.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from scipy.special import ndtr, stdtrit

from plumbline.declared import Count, Declared, Positive, Range
from plumbline.errors import PlumblineError
from plumbline.optim.core.judged import Judgement, Solution, judged
from plumbline.optim.core.problem import Array, Flags, Integers, Problem
from plumbline.optim.core.solvers import LevenbergMarquardt, Solver
from plumbline.optim.core.threads import one_thread
from plumbline.optim.hand_eye import constants, direct
from plumbline.optim.hand_eye.observability import (
    Observability,
    observability,
    refuse_degenerate,
    refuse_lost,
    refuse_unturned,
)
from plumbline.optim.hand_eye.readings import Beam, Frames, Plane, Readings
from plumbline.optim.hand_eye.reweighting import LikelyFit, Variance, likely_fit, scale_told
from plumbline.optim.hand_eye.shapes import arm_shapes, shapes
from plumbline.optim.hand_eye.start import refuse_misread, robust_start

# 1 sigma of what the readings cannot show [m]
Bias = Annotated[float, Range(0.0, constants.LARGEST_NOISE, ")", "give it over 1 / cos - 1, in m")]


@dataclass(frozen=True)
class HandEyeOptions(Declared):
    """What is fitted besides the beam, what is gross, and how many next poses are looked for.

    Raises:
        PlumblineError: A value out of its range.
    """

    shapes: Count = constants.SHAPES  #: smooth shapes a board may take; 0 takes boards as flat
    #: smooth shapes the arm's error may take; 0 takes the arm as its model
    arm: Count = constants.ARM_SHAPES
    #: standard deviation [m] of kappa, the bias of slanted beams over 1 / cos - 1, that no readings
    #: on planes can show; 0 takes them as unbiased, None takes what the recording states, or else
    #: 0.4 mm
    bias: Bias | None = None
    gross: Positive = constants.GROSS  #: errors beyond so many sigmas are gross
    #: how many next poses to look for
    poses: Annotated[int, Range(0, constants.MOST_POSES)] = constants.POSES
    seed: Count = 0  #: of their candidates
    #: what solves the statement in the end
    solver: Solver = field(default_factory=LevenbergMarquardt)


@dataclass(frozen=True, eq=False)
class Calibration:
    """The answer."""

    beam: Beam  # the beam
    covariance: Array  # of (r [m], v), (6, 6)
    planes: tuple[Plane, ...]  # the boards in the base frame, normals away from the flange
    variance: Variance  # of one reading's equation over its incidence
    bow: float  # standard deviation of the boards' unflatness [m]
    arm: float  # standard deviation of the arm's smooth error [m]
    bias: float  # the same of the bias of slanted beams, as it was stated [m]
    readings: Readings  # those that the fit rests on
    incidence: Array  # their angles to the normals [rad]
    errors: Array  # their distances from the (bowed) boards [m]
    gross: Integers  # names of the readings taken for gross errors
    seen: Observability  # what the poses see
    frames: Frames  # frames of the planes
    fit: LikelyFit  # weights and covariance of every unknown
    x: Array  # the solver's point (P,)
    # what the statement says of readings and shapes (N', k); with the frames it makes the
    # :attr:`solution`
    rows: Array
    shapes: int  # smooth shapes of each board
    iterations: int  # how many steps the solver took
    message: str  # what the solver says
    judged: Judgement  # whether the fit converged, by the statement itself
    notes: tuple[str, ...]  # what must be known to read it

    def __repr__(self) -> str:
        r, v = (", ".join(f"{value:.4g}" for value in a) for a in (1e3 * self.beam.r, self.beam.v))
        rows = (
            f"{len(self.readings)} readings on {len(self.planes)} planes, {len(self.gross)} gross"
        )
        return f"<Calibration: beam from ({r}) mm along ({v}); {rows}>"

    @cached_property
    def solution(self) -> Solution:
        """The solver's point with its statement, weights as fitted."""
        planes, biased = len(self.frames.c), self.bias > 0.0
        arm = self.rows.shape[1] - constants.FIXED - planes - self.shapes - biased
        stated = direct.statement(planes, self.shapes, arm, biased)
        problem = stated.on(self.rows, self.fit.relative)
        return Solution(problem, self.x, self.iterations, self.message)

    @property
    def std(self) -> Array:
        """Standard errors (6,) of r [m] and v."""
        return np.sqrt(np.diag(self.covariance))

    def heights(self) -> Array:
        """How far each reading's board stands out there, by the fit (N,) [m]."""
        index = self.frames.index(self.readings)
        return direct.heights(self.solution.problem, self.x, self.frames, index)

    def point_std(self, distance: float) -> float:
        """Standard error [m] of a point rebuilt at that range [m], by the beam's own alone."""
        J = np.hstack([np.eye(3), distance * np.eye(3)])
        return float(np.sqrt(np.trace(J @ self.covariance @ J.T)))


@one_thread()
def calibrate(readings: Readings, options: HandEyeOptions | None = None) -> Calibration:
    """Find the beam from readings on any number of planes.

    Args:
        readings: N readings; planes need not be square to each other.
        options: Robustness, bow, solver.

    Raises:
        PlumblineError: The motions leave the beam open, or the readings contradict each other.
    """
    given = options or HandEyeOptions()
    refuse_degenerate(readings)
    _check_count(readings)
    beam, sigma, good = _robust(readings, given)
    kept = readings.select(good)
    for rounds in range(constants.GROSS_ROUNDS + 1):
        _check_planes(kept, readings)
        frames, problem, fit, incidence = _likely(kept, beam, sigma, given)
        # Before any reading is called gross: where the beam is open, a fit may end anywhere.
        _seen(kept, frames, fit, fit.x, incidence, given)
        if rounds == constants.GROSS_ROUNDS:
            break
        beam = frames.beam(fit.x)
        gross = _gross(fit, incidence, _student(given.gross, _freedom(kept)))
        if not gross.any():
            break
        kept = kept.select(~gross)
    return _answer(readings, kept, frames, problem, fit, incidence, given)


def _robust(readings: Readings, given: HandEyeOptions) -> tuple[Beam, float, Flags]:
    """A beam to start from, the scatter [m], and which readings are good (N,)."""
    beam, sigma, errors = robust_start(readings)
    refuse_unturned(readings, sigma)
    refuse_misread(readings, sigma)
    limit = _student(given.gross, constants.MAD_EFFICIENCY * _freedom(readings))
    return beam, sigma, np.abs(errors) <= limit * sigma


def _freedom(readings: Readings) -> int:
    """How many readings there are beyond the unknowns of beam and planes."""
    return len(readings) - 5 - 3 * len(readings.planes)


def _student(sigmas: float, freedom: float) -> float:
    """What is as rare of Student's t, of a scale that so many residuals tell, as a normal's."""
    return float(-stdtrit(freedom, float(ndtr(-sigmas))))


def _likely(
    kept: Readings, beam: Beam, sigma: float, given: HandEyeOptions
) -> tuple[Frames, Problem, LikelyFit, Array]:
    frames = Frames.of(kept, beam)
    points = beam.points(kept.R, kept.t, kept.distance)
    phi = shapes(kept, frames, points, given.shapes)
    psi = arm_shapes(kept, frames, points, given.arm)
    problem = direct.state(kept, frames, phi, psi, biased=_bias(given) > 0.0)
    x = direct.start(problem, beam, frames)
    incidence = direct.incidence(kept, beam, direct.planes_of(x, frames))
    fit = likely_fit(
        problem, x, incidence, Variance(sigma**2), np.array([sigma, sigma, _bias(given)])
    )
    return frames, problem, fit, incidence


def _bias(given: HandEyeOptions) -> float:
    """Standard deviation of the bias of slanted beams [m]."""
    return constants.BIAS_STD if given.bias is None else given.bias


def _gross(fit: LikelyFit, incidence: Array, limit: float) -> Flags:
    """Which readings lie beyond so many of their own sigmas (N,)."""
    count = len(incidence)
    free = np.maximum(1.0 - fit.leverage[:count], constants.LEAST_FREE)
    sizes = np.abs(fit.errors[:count]) / np.sqrt(fit.variance.at(incidence) * free)
    return np.asarray(sizes > limit)


def _check_count(readings: Readings) -> None:
    least = 5 + 3 * len(readings.planes) + constants.SPARE
    if len(readings) < least:
        raise PlumblineError(
            f"{len(readings)} readings on {len(readings.planes)} planes, at least {least} expected "
            f"(5 unknowns of the beam, 3 of a plane, {constants.SPARE} to judge by); take more"
        )
    poses, unknowns = readings.distinct, least - constants.SPARE
    if poses < unknowns:
        raise PlumblineError(
            f"{poses} distinct poses in {len(readings)} readings on {len(readings.planes)} planes, "
            f"at least {unknowns} expected (5 unknowns of the beam, 3 of a plane); take others"
        )


def _check_planes(kept: Readings, readings: Readings) -> None:
    gone = np.setdiff1d(readings.planes, kept.planes)
    few = [k for k in kept.planes if np.sum(kept.plane == k) < constants.LEAST_ON_PLANE]
    if len(gone) or few:
        k = gone[0] if len(gone) else few[0]
        raise PlumblineError(
            f"plane {k}: {int(np.sum(kept.plane == k))} usable readings of "
            f"{int(np.sum(readings.plane == k))}, at least {constants.LEAST_ON_PLANE} "
            "expected; take more on it"
        )


def _answer(
    readings: Readings,
    kept: Readings,
    frames: Frames,
    problem: Problem,
    fit: LikelyFit,
    incidence: Array,
    given: HandEyeOptions,
) -> Calibration:
    solution = given.solver.solve(replace(problem, weights=fit.relative), fit.x)
    beam = frames.beam(solution.x)
    seen, covariance = _seen(kept, frames, fit, solution.x, incidence, given)
    gross = np.setdiff1d(readings.row, kept.row)
    return Calibration(
        beam=beam,
        covariance=covariance,
        planes=direct.planes_of(solution.x, frames),
        variance=fit.variance,
        bow=float(fit.spreads[constants.BOW]),
        arm=float(fit.spreads[constants.ARM]),
        bias=_bias(given),
        readings=kept,
        incidence=incidence,
        errors=solution.mapped.residuals(solution.x)[: len(kept), 0],
        gross=gross,
        seen=seen,
        frames=frames,
        fit=fit,
        x=solution.x,
        rows=problem.rows,
        shapes=given.shapes,
        iterations=solution.iterations,
        message=solution.message,
        judged=Judgement.of([judged(solution, "the fit of the beam")]),
        notes=(*_notes(readings, gross), *_scale(solution, fit, kept, incidence)),
    )


def _seen(
    kept: Readings,
    frames: Frames,
    fit: LikelyFit,
    x: Array,
    incidence: Array,
    given: HandEyeOptions,
) -> tuple[Observability, Array]:
    """What the poses see, and the beam's covariance (6, 6); refused where the beam is open.

    Its standard errors are such that 1.96 of them hold 95 %, few as the readings may be.
    """
    beam = frames.beam(x)
    covariance = direct.beam_covariance(fit.beam, x, frames)
    covariance *= (_student(constants.NORMAL_95, _freedom(kept)) / constants.NORMAL_95) ** 2
    seen = observability(kept, frames, beam, covariance, incidence, _bias(given))
    refuse_lost(seen, kept, beam, covariance, incidence)
    return seen, covariance


def _scale(solution: Solution, fit: LikelyFit, kept: Readings, incidence: Array) -> tuple[str, ...]:
    """That the finder's scale is off, where the readings say so."""
    value, std = scale_told(solution, fit, kept.distance, incidence)
    if abs(value) <= _student(constants.SCALE_TOLD, _freedom(kept)) * std:
        return ()
    words = f"ranges read {1e2 * value:+.2g} +- {1e2 * std:.1g} % too long, which moves the beam "
    return (f"{words}beyond its errors: divide them by {1 + value:.5f} and ask again",)


def _notes(readings: Readings, gross: Integers) -> tuple[str, ...]:
    notes = []
    if len(readings.planes) == 1:
        notes.append("one plane only: boards in three directions show systematic errors better")
    if len(gross) > constants.MANY_GROSS * len(readings):
        notes.append(f"{len(gross)} of {len(readings)} readings are taken for gross errors: many")
    if len(readings) < constants.FEW_READINGS * (5 + 3 * len(readings.planes)):
        notes.append(f"{len(readings)} readings are few: errors are themselves uncertain")
    return tuple(notes)

"""A sweep of a needle about a lesion: one joint path, planned at once and checked afterwards.

Branches of the inverse kinematics are followed along the sweep; the best of them starts IPOPT on
the whole path (:mod:`plumbline.optim.pointing.statement`); Pinocchio and coal judge what comes of
it.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import JudgedByResidual, Judgement, Solution
from plumbline.optim.core.judged import judged as judged_path
from plumbline.optim.core.problem import Array, Flags
from plumbline.optim.core.quantities import counted
from plumbline.optim.pointing.aim import Aim, checked_angles, tip_and_top
from plumbline.optim.pointing.between import (
    Between,
    Planes,
    before_planes,
    between,
    whole_way,
    with_ways,
)
from plumbline.optim.pointing.constants import HELD_WITHIN, LOOKS, PATIENCE, ROUNDS, SPARE
from plumbline.optim.pointing.judge import Angles, drift, judged, settled_status, why_not
from plumbline.optim.pointing.options import PointingOptions
from plumbline.optim.pointing.postures import Tracks, follow
from plumbline.optim.pointing.statement import sweep_statement
from plumbline.optim.pointing.status import Status
from plumbline.optim.pointing.surroundings import Clearance
from plumbline.optim.pointing.task import NeedleTask, smallest_singular_values

NO_SOLVE = JudgedByResidual("no solve: the track that the path starts from", False, float("nan"))


@dataclass(frozen=True, eq=False)
class _Path:
    """Postures (K, n), what the solver said, its steps, and how it ended by our own measure."""

    q: Array
    message: str
    iterations: int
    judged: JudgedByResidual


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Answer):
    """A planned sweep and, angle by angle, how good it is. NaN where no posture was found."""

    aim: Aim  # what was pointed at, with which arm
    theta: Array  # puncture angles (K,) [rad]
    beta: Array  # azimuths (K,) [rad]
    joints: Array  # the path (K, n) [rad or m]
    status: tuple[Status, ...]  # what becomes of each angle (K)
    reasons: tuple[str, ...]  # why, in words (K)
    rcm_error: Array  # distance of the tool centre point from the lesion, by Pinocchio (K,) [m]
    direction_error: Array  # angle between needle and wanted direction, by Pinocchio (K,) [rad]
    singular_value: Array  # smallest one of the needle's task, by Pinocchio (K,) [rad/rad]
    # least of all pairs that must not meet, by coal (K,) [m]; infinite if there are none
    clearance: Array
    step: Array  # largest motion of a joint since the angle before (K,) [rad], 0 at the first
    message: str  # what the solver said; never used to judge
    iterations: int  # how many steps it took
    # largest distance of the tool centre point from the lesion midway from the angle before, if
    # joints move in straight lines, by Pinocchio (K,) [m]; 0 at the first
    drift: Array = field(default_factory=lambda: np.zeros(0))
    # least clearances by name over the whole way, the one nearest to its limit first. Between
    # angles they are those that coal was asked for; what it was not asked for is proven to keep its
    # limit.
    pairs: tuple[Clearance, ...] = ()
    # pairs that meet by the arm's build or mounting, whatever its posture
    left_out: tuple[str, ...] = ()
    # whether it converged: stationarity, feasibility and bounds, recomputed
    solve: JudgedByResidual = NO_SOLVE
    # pairs that the solve had rows for; all others are judged alone, as needle and path beside what
    # stands must be: the angles decide where they are
    constrained: tuple[str, ...] = ()

    @property
    def judged(self) -> Judgement:
        """Whether the solve converged."""
        return Judgement.of([self.solve])

    @property
    def safe(self) -> Flags:
        """Which angles are safe (K,)."""
        return np.array([status == Status.SAFE for status in self.status])

    @property
    def is_safe(self) -> bool:
        """Whether the whole sweep is."""
        return bool(self.safe.all())

    @property
    def tips_and_tops(self) -> tuple[Array, Array]:
        """Tip and top of the needle at each angle, each (K, 3), in robot coordinates [m]."""
        a = self.aim
        return tip_and_top(a.T_robot_ct, a.lesion, a.needle, self.theta, self.beta)

    def __len__(self) -> int:
        return len(self.theta)

    def __repr__(self) -> str:
        off = self.rcm_error[np.isfinite(self.rcm_error)]
        kept = f"off the lesion by {1e3 * off.max():.2g} mm" if off.size else "no path through all"
        return f"<Sweep of {counted(len(self), 'angle')}: {int(self.safe.sum())} safe; {kept}>"


def plan_sweep(
    aim: Aim, theta: ArrayLike, beta: ArrayLike, options: PointingOptions | None = None
) -> Sweep:
    """Plan a joint path that turns the needle about the lesion through all angles, in their order.

    Angles that cannot be reached do not raise: their status says why. The problem is compiled at
    the first call for a chain and a number of angles.

    Args:
        aim: Arm, needle, lesion and body.
        theta: Puncture angles from the CT's z axis [rad], broadcast against beta.
        beta: Azimuths from the CT's x axis [rad].
        options: What counts as safe.

    Raises:
        PlumblineError: Angles out of range or not finite.
    """
    asked = Angles.of(aim, options, *(values.ravel() for values in checked_angles(theta, beta)))
    tracks = follow(asked.arm, asked.rows)
    ranked = _ranked(asked, tracks)[: asked.options.branches]
    if ranked:
        return max((_planned(asked, tracks.q[b], tracks.reached[b]) for b in ranked), key=_merit)
    nowhere = np.full((len(asked.rows), aim.chain.n), np.nan)
    return _reported(asked, _Path(nowhere, "no posture to start from", 0, NO_SOLVE))[0]


def _planned(asked: Angles, track: Array, held: Flags) -> Sweep:
    """A track's path; planned again in front of planes while the arm comes too near something."""
    aim, around = asked.aim, asked.around
    solved = _path(asked, track, held)
    now, ways = _reported(asked, _released(solved, held))
    best, nearest, idle = now, (-1.0, -np.inf), 0
    for k in range(ROUNDS):
        idle = 0 if _nearness(now) > nearest else idle + 1
        if Status.COLLISION not in now.status or not around.of_arm.any() or idle == PATIENCE:
            break
        nearest = max(nearest, _nearness(now))
        planes = before_planes(aim, around, asked.arm.task, now.joints, ways, SPARE * 2**k)
        solved = _path(asked, solved.q, held, planes)
        now, ways = _reported(asked, _released(solved, held))
        now = replace(now, constrained=tuple(sorted(planes.pairs)))
        if _merit(now) > _merit(best):
            best = now
    return best


def _nearness(sweep: Sweep) -> tuple[float, float]:
    """How much is safe, and the worst pair's clearance beyond its limit [m]."""
    spare = [pair.distance - pair.limit for pair in sweep.pairs[:1]]
    return (float(sweep.safe.mean()), min(spare, default=np.inf))


def _released(solved: _Path, held: Flags) -> _Path:
    """The same with no postures where the needle is not held."""
    return replace(solved, q=np.where(held[:, None], solved.q, np.nan))


def _ranked(asked: Angles, tracks: Tracks) -> list[int]:
    """Indices of the tracks, the most promising first: what they hold, clear of what, how well."""
    count, K = tracks.reached.shape
    looks = np.unique(np.linspace(0, K - 1, LOOKS).round().astype(int))
    task, options, merits = asked.arm.task, asked.options, []
    for b in range(count):
        q, held = tracks.q[b], tracks.reached[b]
        sigma = smallest_singular_values(task, q, asked.rows)
        smooth = _steps(task, q) <= options.longest_step
        good = held & (sigma >= options.least_singular_value) & smooth
        seen = looks[held[looks]]
        clear = float(asked.around.clear(asked.some(seen).capsules(q[seen])).sum())
        least = float(sigma[held].min(initial=np.inf))
        merits.append(
            (float(good.mean()) * clear / len(looks), float(held.mean()), min(least, 1e3))
        )
    return sorted(range(count), key=lambda b: merits[b], reverse=True)


def _steps(task: NeedleTask, q: Array) -> Array:
    """Largest motion (K,) of a joint of a path (K, n) since the posture before, 0 at the first."""
    moves = np.abs(np.diff(q, axis=0) / task.steps).max(axis=1, initial=0.0)
    return np.concatenate([[0.0], moves])


def _path(asked: Angles, track: Array, held: Flags, planes: Planes | None = None) -> _Path:
    """The path from a track; without bounds on the steps, or the track itself, if that fails."""
    arm, options, rows = asked.arm, asked.options, asked.rows
    task = arm.task
    statement = sweep_statement(task, len(rows), options.weights, planes is not None)
    for longest in (options.longest_step, np.inf):
        problem = statement.at(rows, held, arm.lower, arm.upper, longest, planes)
        found = options.solver.solve(problem, statement.start(track))
        q = arm.clip(statement.postures(found.x))
        if not np.isfinite(q).all():
            continue
        # Point and direction: a path that lets go of either to keep its steps short is none.
        away = np.linalg.norm(task.seek(q, rows)[0], axis=1) * rows[:, 6]
        if away[held].max(initial=0.0) <= HELD_WITHIN:
            return _Path(q, found.message, found.iterations, _judged(found))
    return _Path(track, f"the track itself ({found.message})", found.iterations, NO_SOLVE)


def _judged(found: Solution) -> JudgedByResidual:
    judgement = judged_path(found, "the path")
    assert isinstance(judgement, JudgedByResidual)  # its problem has an objective
    return judgement


def _reported(asked: Angles, solved: _Path) -> tuple[Sweep, Between]:
    q, aim, around = solved.q, asked.aim, asked.around
    found, steps = judged(asked, q), _steps(asked.arm.task, q)
    ways = between(aim, around, q, found.values)
    missing = np.flatnonzero(~np.isfinite(q).all(axis=1))
    why = why_not(asked.some(missing))
    status, reasons = settled_status(found, asked.options, steps, missing, why)
    status, reasons = with_ways(status, reasons, around, ways)
    pairs = whole_way(around, q, found.values, ways)
    sweep = Sweep(
        aim, asked.theta, asked.beta, q, status, reasons, found.rcm_error, found.direction_error,
        found.singular_value, found.clearance, steps, solved.message, solved.iterations,
        drift(aim, q), pairs, around.left_out, solved.judged,
    )  # fmt: skip
    return sweep, ways


def _merit(sweep: Sweep) -> tuple[float, float, float]:
    """More safe angles first, then the distance from singularities, then a short path."""
    sigma = sweep.singular_value[np.isfinite(sweep.singular_value)]
    return (float(sweep.safe.mean()), float(sigma.min(initial=1e3)), -float(np.nansum(sweep.step)))

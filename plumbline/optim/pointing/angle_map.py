"""Which puncture angles are safe: a map over theta and beta, every angle on its own.

Each angle is sought from the same starts; of the postures found, the one farthest from a
singularity that is clear of the body is kept. Angles left over are tried again from their
neighbours' postures. Whether one motion joins the angles is what a sweep says.
"""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plumbline.errors import PlumblineError
from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import Judged, Judgement
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.pointing import constants
from plumbline.optim.pointing.aim import Aim, checked_angles
from plumbline.optim.pointing.judge import Angles, Found, judged, why_not
from plumbline.optim.pointing.options import PointingOptions
from plumbline.optim.pointing.postures import settled, solved, starts
from plumbline.optim.pointing.status import Status
from plumbline.optim.pointing.surroundings import Clearance
from plumbline.optim.pointing.task import Bounded, NeedleTask, smallest_singular_values


@dataclass(frozen=True, repr=False)
class _Held(Judged):
    """Postures by how far they are off the lesion."""

    limit: float = constants.LARGEST_RCM_ERROR
    unit: ClassVar[str] = "m off the lesion"


@dataclass(frozen=True, eq=False, repr=False)
class AngleMap(Answer):
    """Safe and unsafe angles over a grid of T puncture angles and B azimuths."""

    aim: Aim  # what is pointed at, with which arm
    theta: Array  # puncture angles (T,) [rad]
    beta: Array  # azimuths (B,) [rad]
    status: NDArray[np.str_]  # what becomes of each angle (T, B), of :class:`Status`
    reasons: NDArray[np.str_]  # why, in words (T, B)
    joints: Array  # A posture for each angle (T, B, n) [rad or m]; NaN where there is none
    rcm_error: Array  # distance of the tool centre point from the lesion (T, B) [m]
    singular_value: Array  # smallest one of the needle's task (T, B) [rad/rad]
    clearance: Array  # least of all pairs that must not meet (T, B) [m]; infinite if there are none
    spare: Array  # how much of the stand-off lies outside of the body (T, B) [m]
    # of each blocked or colliding angle the :class:`Clearance` that falls shortest of its limit;
    # ``where`` counts angles row by row
    too_near: tuple[Clearance, ...]

    @property
    def safe(self) -> Flags:
        """Which angles are safe (T, B)."""
        return np.asarray(self.status == Status.SAFE)

    @property
    def cone(self) -> float:
        """Largest theta of the grid up to which every azimuth is safe [rad]; NaN if none is."""
        rings = np.logical_and.accumulate(self.safe.all(axis=1))
        return float(self.theta[rings][-1]) if rings.any() else float("nan")

    def counts(self) -> tuple[tuple[Status, int], ...]:
        """How many angles there are of each status, the most frequent first."""
        found = Counter(self.status.ravel().tolist())
        return tuple((Status(kind), number) for kind, number in found.most_common())

    def __repr__(self) -> str:
        found = ", ".join(f"{number} {kind.value}" for kind, number in self.counts())
        return f"<AngleMap of {self.status.size} angles: {found}>"

    @cached_property
    def worst(self) -> NDArray[np.object_]:
        """Of each blocked or colliding angle what falls shortest of its limit, else None (T, B)."""
        found = np.full(self.status.size, None, dtype=object)
        for near in self.too_near:
            found[int(near.where)] = near
        return found.reshape(self.status.shape)

    @cached_property
    def judged(self) -> Judgement:
        """Whether every posture holds the needle, by Pinocchio."""
        off = float(np.nan_to_num(self.rcm_error).max(initial=0.0))
        good = off <= constants.LARGEST_RCM_ERROR
        return Judgement.of([_Held("the postures", good, off)])


def safe_angle_map(
    aim: Aim, theta: ArrayLike, beta: ArrayLike, options: PointingOptions | None = None
) -> AngleMap:
    """Judge every pair of a puncture angle and an azimuth, saying why where one cannot be reached.

    Args:
        aim: Arm, needle, lesion and body.
        theta: Puncture angles (T,), ascending [rad].
        beta: Azimuths (B,) [rad].
        options: What counts as safe.

    Raises:
        PlumblineError: Angles out of range, not finite or not ascending.
    """
    thetas, betas = np.atleast_1d(theta), np.atleast_1d(beta)
    if thetas.ndim != 1 or betas.ndim != 1:
        raise PlumblineError(
            f"theta {thetas.shape} and beta {betas.shape}: one axis each expected; the map is "
            "their grid"
        )
    grid = checked_angles(thetas[:, None], betas[None, :])
    if (np.diff(grid[0][:, 0]) <= 0).any():
        raise PlumblineError("theta: ascending values expected; sort them and drop repeated ones")
    T, B = grid[0].shape
    asked = Angles.of(aim, options, grid[0].ravel(), grid[1].ravel())
    candidates, missed = _candidates(asked.arm, asked.rows, (T, B))
    q, found = _chosen(asked, candidates)
    status, reasons = list(found.status), list(found.reasons)
    missing = np.array([k for k, s in enumerate(status) if s == Status.REACH], dtype=np.intp)
    why = why_not(asked.some(missing), missed[missing])
    for k, (kind, words) in zip(missing.tolist(), why, strict=True):
        status[k], reasons[k] = kind, words
    told = (found.rcm_error, found.singular_value, found.clearance, found.spare)
    rcm_error, singular_value, clearance, spare = (values.reshape(T, B) for values in told)
    return AngleMap(
        aim, grid[0][:, 0], grid[1][0], np.array(status).reshape(T, B),
        np.array(reasons).reshape(T, B), q.reshape(T, B, -1), rcm_error,
        singular_value, clearance, spare,
        tuple(near for near in found.worst if near is not None),
    )  # fmt: skip


def _candidates(arm: Bounded, rows: Array, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Postures (N, TRIES, n), the farthest from a singularity first, and least squares (N,)."""
    task = arm.task
    q = np.tile(starts(task, constants.STARTS), (len(rows), 1))
    repeated = np.repeat(rows, constants.STARTS, axis=0)
    q, found, cost = solved(arm, q, repeated)
    best = _best(task, q, found, repeated, len(rows))
    for _ in range(constants.MAP_ROUNDS):
        empty = np.flatnonzero(np.isnan(best[:, 0, 0]))
        around = best[_neighbours(empty, shape), 0].reshape(-1, q.shape[1])
        here = np.repeat(rows[empty], 4, axis=0)
        there = np.isfinite(around).all(axis=1)
        if not there.any():
            break
        tried = np.zeros(len(here), dtype=bool)
        x = np.zeros_like(around)
        x[there], tried[there], _ = solved(arm, around[there], here[there])
        if not tried.any():
            break
        best[empty] = _best(task, x, tried, here, len(empty))
    flat = best.reshape(-1, q.shape[1])
    there = np.isfinite(flat).all(axis=1)
    flat[there] = settled(arm, flat[there], np.repeat(rows, constants.TRIES, axis=0)[there])
    return flat.reshape(best.shape), cost.reshape(len(rows), -1).min(axis=1)


def _best(task: NeedleTask, q: Array, found: Flags, rows: Array, count: int) -> Array:
    """Of each angle's tries the TRIES best postures (count, TRIES, n), no two of them alike."""
    sigma = np.where(found, smallest_singular_values(task, q, rows), -1.0).reshape(count, -1)
    tries = q.reshape(count, sigma.shape[1], -1)
    best = np.full((count, constants.TRIES, q.shape[1]), np.nan)
    for k in range(constants.TRIES):
        top = np.argmax(sigma, axis=1)
        value = np.take_along_axis(sigma, top[:, None], axis=1)
        best[:, k] = np.where(value > 0.0, tries[np.arange(count), top], np.nan)
        # The same branch has the same singular values, wherever its free turn may be.
        sigma[np.abs(sigma - value) < constants.SAME_VALUE] = -1.0
    return best


def _neighbours(cells: Indices, shape: tuple[int, int]) -> Indices:
    """Indices (N, 4) of the cells below, above, before and behind; azimuths go round."""
    i, j = np.divmod(cells, shape[1])
    around = [
        (np.clip(i - 1, 0, None), j), (np.clip(i + 1, None, shape[0] - 1), j),
        (i, (j - 1) % shape[1]), (i, (j + 1) % shape[1]),
    ]  # fmt: skip
    return np.stack([a * shape[1] + b for a, b in around], axis=1)


def _chosen(asked: Angles, candidates: Array) -> tuple[Array, Found]:
    """The first safe posture of each angle, else the first."""
    q = candidates[:, 0].copy()
    for k in range(1, constants.TRIES):
        found = judged(asked, q, False)
        unsafe = np.array([s in (Status.COLLISION, Status.SINGULAR) for s in found.status])
        again = np.flatnonzero(unsafe & np.isfinite(candidates[:, k, 0]))
        if not len(again):
            break
        other = judged(asked.some(again), candidates[again, k], False)
        safe = np.array([s == Status.SAFE for s in other.status])
        q[again[safe]] = candidates[again[safe], k]
    return q, judged(asked, q, False)

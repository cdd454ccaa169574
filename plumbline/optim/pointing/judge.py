"""What becomes of each angle: Pinocchio's and coal's findings against the limits, in words.

Nothing of a plan's quality is taken from its solver.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import pinocchio as pin

from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.pointing import constants
from plumbline.optim.pointing.aim import Aim
from plumbline.optim.pointing.options import PointingOptions
from plumbline.optim.pointing.postures import solved, starts
from plumbline.optim.pointing.status import Status
from plumbline.optim.pointing.surroundings import Clearance, Surroundings, surroundings
from plumbline.optim.pointing.task import Bounded, needle_task, pointed


@dataclass(frozen=True, eq=False)
class Angles:
    """Angles (N,) of an aim, and what postures there are judged by."""

    aim: Aim  # what is pointed at, with which arm
    options: PointingOptions  # what counts as safe
    theta: Array  # puncture angles (N,) [rad]
    beta: Array  # azimuths (N,) [rad]
    around: Surroundings  # what must not meet

    @classmethod
    def of(cls, aim: Aim, options: PointingOptions | None, theta: Array, beta: Array) -> Self:
        """By the default options if none are given."""
        given = options or PointingOptions()
        return cls(aim, given, theta, beta, surroundings(aim, given.least_clearance))

    @cached_property
    def arm(self) -> Bounded:
        """The needle's task within the joints' limits."""
        return self.options.bounded(needle_task(self.aim.chain, self.aim.needle.axis))

    @cached_property
    def rows(self) -> Array:
        """Data of the task (N, 7)."""
        return self.aim.rows(self.theta, self.beta)

    def some(self, which: Indices) -> Self:
        """Some of the angles."""
        return replace(self, theta=self.theta[which], beta=self.beta[which])

    def capsules(self, q: Array) -> Array:
        """Axes of all capsules (N, M, 2, 3) [m] at postures (N, n), the needle as it should be."""
        return pointed(self.aim, q, self.theta, self.beta)


@dataclass(frozen=True, eq=False)
class Checked:
    """What Pinocchio finds at postures; NaN where a posture is."""

    rcm_error: Array  # distance of the tool centre point from the lesion (N,) [m]
    direction_error: Array  # angle between the needle and the wanted direction (N,) [rad]
    singular_value: Array  # smallest singular value of the needle's task (N,) [rad/rad]


def checked(aim: Aim, q: Array, theta: Array, beta: Array) -> Checked:
    """Postures (N, n) for angles (N,) [rad], by Pinocchio's kinematics and Jacobians."""
    model = aim.chain.model
    data = model.createData()
    T_last_tip = pin.SE3(aim.chain.T_last_tip)
    axis = np.asarray(aim.needle.axis)
    steps = needle_task(aim.chain, aim.needle.axis).steps
    inward = -aim.outward(theta, beta)
    found = np.full((len(q), 3), np.nan)
    for k in np.flatnonzero(np.isfinite(q).all(axis=1)):
        configuration = aim.chain.configuration(q[k])
        pin.computeJointJacobians(model, data, configuration)
        T = data.oMi[aim.chain.n] * T_last_tip
        needle = T.rotation @ axis
        arm = aim.needle.reach * needle
        point = T.translation + arm
        J = pin.getJointJacobian(model, data, aim.chain.n, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        lever = point - data.oMi[aim.chain.n].translation
        at_point = J[:3] - pin.skew(lever) @ J[3:]
        task = np.vstack([at_point / aim.needle.reach, -pin.skew(needle) @ J[3:]]) * steps
        sizes = np.linalg.svd(task, compute_uv=False)
        away = np.linalg.norm(point - aim.target)
        turned = np.arctan2(np.linalg.norm(np.cross(needle, inward[k])), needle @ inward[k])
        found[k] = away, turned, sizes[constants.EQUATIONS - 1]
    return Checked(*found.T)


def drift(aim: Aim, q: Array) -> Array:
    """How far the tool centre point is from the lesion midway to each posture (K,) [m]."""
    found = np.zeros(len(q))
    middle = (q[1:] + q[:-1]) / 2
    angles = np.zeros(len(middle))
    found[1:] = checked(aim, middle, angles, angles).rcm_error
    return found


@dataclass(frozen=True, eq=False)
class Found(Checked):
    """One status an angle, and what it rests on; NaN where there is no posture."""

    status: tuple[Status, ...]  # (N)
    reasons: tuple[str, ...]  # the same in a few words with value and limit (N)
    clearance: Array  # least of all pairs that must not meet (N,) [m]; infinite if there are none
    spare: Array  # how much of the stand-off lies outside of the body (N,) [m]
    # clearances of all pairs (N, P), lower bounds of those that are not a nearest [m]
    values: Array
    # of each blocked or colliding angle what falls shortest of its limit, else None (N)
    worst: tuple[Clearance | None, ...]


def judged(asked: Angles, q: Array, pairs_too: bool = True) -> Found:
    """Judge postures (N, n) for angles; rows of NaN are angles without a posture.

    ``pairs_too``: whether each pair's nearest is told exactly, too, not only each angle's.
    """
    aim, around = asked.aim, asked.around
    found = checked(aim, q, asked.theta, asked.beta)
    values = around.table(asked.capsules(q), pairs_too)
    clearance = values.min(axis=1, initial=np.inf)
    clearance[~np.isfinite(q).all(axis=1)] = np.nan
    spare = aim.needle.standoff - aim.way_out(asked.theta, asked.beta)
    held = (found.rcm_error <= constants.LARGEST_RCM_ERROR) & (
        found.direction_error <= constants.LARGEST_TURN
    )
    status, reasons, worst = [], [], []
    for k in range(len(q)):
        blocked = _shortest(around, values[k], k, around.on_path)
        near = _shortest(around, values[k], k, ~around.on_path)
        kind, words = _verdict(
            asked.options, bool(held[k]), found.singular_value[k], near, blocked, spare[k]
        )
        status.append(kind)
        reasons.append(words)
        worst.append({Status.BLOCKED: blocked, Status.COLLISION: near}.get(kind))
    judged = tuple(status), tuple(reasons), clearance, spare, values, tuple(worst)
    return Found(found.rcm_error, found.direction_error, found.singular_value, *judged)


def _shortest(around: Surroundings, values: Array, k: int, which: Flags) -> Clearance | None:
    """Of some pairs of one angle the one that falls shortest of its limit, if any does."""
    short = np.where(which, values - around.limits, np.inf)
    p = int(short.argmin()) if short.size else -1
    if p < 0 or short[p] >= 0.0:
        return None
    pair = around.pairs[p]
    return Clearance(pair.first, pair.second, float(values[p]), pair.limit, float(k))


def _verdict(
    options: PointingOptions, held: bool, sigma: float, near: Clearance | None,
    blocked: Clearance | None, spare: float,
) -> tuple[Status, str]:  # fmt: skip
    if spare < options.least_clearance:
        return Status.INSIDE, (
            f"tip {1e3 * spare:.1f} mm outside of the body, at least "
            f"{1e3 * options.least_clearance:g} mm; choose a longer stand-off"
        )
    if blocked is not None:
        return Status.BLOCKED, blocked.words
    if not held:
        return Status.REACH, "no posture found"
    if near is not None:
        return Status.COLLISION, near.words
    if sigma < options.least_singular_value:
        least = options.least_singular_value
        return Status.SINGULAR, f"smallest singular value {sigma:.4f}, at least {least:g}"
    return Status.SAFE, "safe"


def why_not(asked: Angles, missed: Array | None = None) -> list[tuple[Status, str]]:
    """Why no posture was found for angles (N), ``JUMP`` where some posture does hold.

    ``missed`` (N,) are the least sums of squares of the equations within the limits, where known.
    """
    arm = asked.arm
    wider = inside = _best_of_starts(arm, asked.rows) if missed is None else missed
    turning = arm.task.chain.turning
    if (turning & (arm.upper - arm.lower < constants.TURN)).any():
        endless = np.where(turning, np.inf, 0.0)
        wide = replace(arm, lower=arm.lower - endless, upper=arm.upper + endless)
        wider = _best_of_starts(wide, asked.rows)
    return [_why(i, w, asked.aim.needle.reach) for i, w in zip(inside, wider, strict=True)]


def _why(inside: float, wider: float, reach: float) -> tuple[Status, str]:
    if inside <= constants.ZERO:
        return Status.JUMP, "held by another posture of the arm only"
    if wider <= constants.ZERO:
        return Status.LIMIT, "held only beyond the joint limits; mount the arm elsewhere"
    miss = f"{1e3 * float(np.sqrt(wider)) * reach:.0f} mm"
    return Status.REACH, f"the best posture misses by {miss}; mount the arm elsewhere"


def _best_of_starts(arm: Bounded, rows: Array) -> Array:
    """Least sum of squares (N,) that any start reaches at rows (N, 7)."""
    if not len(rows):
        return np.empty(0)
    first = starts(arm.task, constants.WHY_STARTS)
    q, repeated = np.tile(first, (len(rows), 1)), np.repeat(rows, len(first), axis=0)
    cost = solved(arm, q, repeated)[2]
    return np.asarray(cost.reshape(len(rows), -1).min(axis=1))


def settled_status(
    found: Found, options: PointingOptions, steps: Array, missing: Indices,
    why: list[tuple[Status, str]],
) -> tuple[tuple[Status, ...], tuple[str, ...]]:  # fmt: skip
    """Statuses with the reasons of missing angles, and with the leaps along the path."""
    status, reasons = list(found.status), list(found.reasons)
    for k, (kind, words) in zip(missing.tolist(), why, strict=True):
        if status[k] not in (Status.INSIDE, Status.BLOCKED):
            status[k], reasons[k] = kind, words
    for k in np.flatnonzero(steps > constants.BEYOND * options.longest_step).tolist():
        if status[k] == Status.SAFE:
            status[k] = Status.JUMP
            reasons[k] = f"a joint moves by {steps[k]:.2f}, at most {options.longest_step:g}"
    return tuple(status), tuple(reasons)

"""What becomes of each angle: Pinocchio's and coal's findings against the limits, in words.

Nothing of a plan's quality is taken from its solver.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.pointing import constants
from plumbline.optim.pointing.aim import Aim
from plumbline.optim.pointing.options import PointingOptions
from plumbline.optim.pointing.postures import solved, starts
from plumbline.optim.pointing.status import Status
from plumbline.optim.pointing.surroundings import Clearance, Surroundings, surroundings
from plumbline.optim.pointing.task import NeedleTask, pointed


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
    axis, steps = np.asarray(aim.needle.axis), _steps(aim)
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
    return Checked(found[:, 0], found[:, 1], found[:, 2])


def _steps(aim: Aim) -> Array:
    turning = np.array(aim.chain.kinds) == "revolute"
    return np.where(turning, 1.0, aim.chain.reach)


def drift(aim: Aim, q: Array) -> Array:
    """How far the tool centre point is from the lesion midway to each posture (K,) [m]."""
    found = np.zeros(len(q))
    middle = (q[1:] + q[:-1]) / 2
    angles = np.zeros(len(middle))
    found[1:] = checked(aim, middle, angles, angles).rcm_error
    return found


@dataclass(frozen=True, eq=False)
class Found:
    """One status an angle, and what it rests on; NaN where there is no posture."""

    status: tuple[Status, ...]  # (N)
    reasons: tuple[str, ...]  # the same in a few words with value and limit (N)
    rcm_error: Array  # distance of the tool centre point from the lesion (N,) [m]
    direction_error: Array  # angle between needle and wanted direction (N,) [rad]
    singular_value: Array  # smallest singular value of the needle's task (N,) [rad/rad]
    clearance: Array  # least of all pairs that must not meet (N,) [m]; infinite if there are none
    spare: Array  # how much of the stand-off lies outside of the body (N,) [m]
    # clearances of all pairs (N, P), lower bounds of those that are not a nearest [m]
    values: Array
    # of each blocked or colliding angle what falls shortest of its limit, else None (N)
    worst: tuple[Clearance | None, ...]


def judged(
    aim: Aim, options: PointingOptions, q: Array, theta: Array, beta: Array,
    around: Surroundings | None = None, pairs_too: bool = True,
) -> Found:  # fmt: skip
    """Judge postures (N, n) for angles (N,) [rad]; rows of NaN are angles without a posture.

    ``pairs_too``: whether each pair's nearest is told exactly, too, not only each angle's.
    """
    found = checked(aim, q, theta, beta)
    around = around or surroundings(aim, options.least_clearance)
    values = around.table(pointed(aim, q, theta, beta), pairs_too).values
    clearance = values.min(axis=1, initial=np.inf)
    clearance[~np.isfinite(q).all(axis=1)] = np.nan
    spare = aim.needle.standoff - aim.way_out(theta, beta)
    status, reasons = [Status.SAFE] * len(q), ["safe"] * len(q)
    worst: list[Clearance | None] = [None] * len(q)
    for k in range(len(q)):
        held = (
            found.rcm_error[k] <= constants.LARGEST_RCM_ERROR
            and found.direction_error[k] <= constants.LARGEST_TURN
        )
        blocked = _shortest(around, values[k], k, around.on_path)
        near = _shortest(around, values[k], k, ~around.on_path)
        status[k], reasons[k] = _verdict(
            options, bool(held), found.singular_value[k], near, blocked, spare[k]
        )
        worst[k] = {Status.BLOCKED: blocked, Status.COLLISION: near}.get(status[k])
    return Found(
        tuple(status), tuple(reasons), found.rcm_error, found.direction_error,
        found.singular_value, clearance, spare, values, tuple(worst),
    )  # fmt: skip


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


def why_not(
    aim: Aim,
    task: NeedleTask,
    options: PointingOptions,
    theta: Array,
    beta: Array,
    missed: Array | None = None,
) -> list[tuple[Status, str]]:
    """Why no posture was found for angles (N,) [rad], ``JUMP`` where some posture does hold.

    ``missed`` (N,) are the least sums of squares of the equations within the limits, where known.
    """
    rows = aim.rows(theta, beta)
    lower, upper = options.limits(task)
    inside = best_of_starts(task, rows, lower, upper) if missed is None else missed
    turning = np.array(task.chain.kinds) == "revolute"
    wider = inside
    if (turning & (upper - lower < constants.TURN)).any():
        endless = np.where(turning, np.inf, 0.0)
        wider = best_of_starts(task, rows, lower - endless, upper + endless)
    return [_why(i, w, aim.needle.reach) for i, w in zip(inside, wider, strict=True)]


def _why(inside: float, wider: float, reach: float) -> tuple[Status, str]:
    if inside <= constants.ZERO:
        return Status.JUMP, "held by another posture of the arm only"
    if wider <= constants.ZERO:
        return Status.LIMIT, "held only beyond the joint limits; mount the arm elsewhere"
    miss = f"{1e3 * float(np.sqrt(wider)) * reach:.0f} mm"
    return Status.REACH, f"the best posture misses by {miss}; mount the arm elsewhere"


def best_of_starts(task: NeedleTask, rows: Array, lower: Array, upper: Array) -> Array:
    """Least sum of squares (N,) that any start reaches at rows (N, 7)."""
    if not len(rows):
        return np.empty(0)
    first = starts(task, constants.WHY_STARTS)
    q, repeated = np.tile(first, (len(rows), 1)), np.repeat(rows, len(first), axis=0)
    cost = solved(task, q, repeated, lower, upper)[2]
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
    for k in np.flatnonzero(steps > 1.001 * options.longest_step).tolist():
        if status[k] == Status.SAFE:
            status[k] = Status.JUMP
            reasons[k] = f"a joint moves by {steps[k]:.2f}, at most {options.longest_step:g}"
    return tuple(status), tuple(reasons)

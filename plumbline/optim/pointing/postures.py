r"""Inverse kinematics of many targets at once, and its branches followed along a sweep of angles.

Levenberg-Marquardt on all rows together (Madsen, Nielsen, Tingleff 2004, algorithm 3.16); joints
that a step would push out of their range leave it. Starts are a lattice of the generalised golden
ratio (Roberts 2018): every run tries the same ones.

.. math:: x_k = \{ \tfrac12 + k\, (g^{-1}, ..., g^{-n}) \}, \qquad g^{n+1} = g + 1

An arm reaches a pointing needle in several ways (elbow up or down, wrist flipped); each way that is
found at some anchor angles is followed to both ends by Newton steps of least motion. These tracks
are where the planner starts from.
"""

from dataclasses import dataclass

import numpy as np

from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.pointing import constants
from plumbline.optim.pointing.task import Bounded, NeedleTask


def starts(task: NeedleTask, count: int) -> Array:
    """Postures (count, n) spread over the joints' ranges, of turning ones over one turn at most."""
    n = task.chain.n
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (n + 1))
    shares = (0.5 + np.outer(np.arange(count), ratio ** -np.arange(1, n + 1))) % 1.0
    half = np.where(task.chain.turning, np.pi, task.chain.reach)
    low = np.maximum(task.chain.lower, task.home - half)
    high = np.minimum(task.chain.upper, task.home + half)
    return low + shares * (high - low)


def solved(arm: Bounded, q: Array, rows: Array) -> tuple[Array, Flags, Array]:
    """Postures (N, n) that hold the needle, which do (N,), and the sums of squares (N,)."""
    x = arm.clip(q)
    r, J = arm.task.seek(x, rows)
    cost, mu = (r**2).sum(axis=1), np.full(len(x), constants.FIRST_DAMPING)
    stalled = np.zeros(len(x), dtype=int)
    for _ in range(constants.ITERATIONS):
        live = np.flatnonzero((cost > constants.ZERO) & (stalled < constants.STALLED))
        if not len(live):
            break
        trial = _step(arm, x[live], r[live], J[live], mu[live])
        r_new, J_new = arm.task.seek(trial, rows[live])
        cost_new = (r_new**2).sum(axis=1)
        better = cost_new < cost[live]
        slow = cost_new > constants.GAINS * cost[live]
        stalled[live] = np.where(slow, stalled[live] + 1, 0)
        damped = np.where(better, mu[live] / constants.SOFTER, mu[live] * constants.HARDER)
        mu[live] = np.clip(damped, constants.LEAST_DAMPING, constants.MOST_DAMPING)
        taken = live[better]
        x[taken], r[taken], J[taken] = trial[better], r_new[better], J_new[better]
        cost[taken] = cost_new[better]
    return x, cost <= constants.ZERO, cost


def _step(arm: Bounded, x: Array, r: Array, J: Array, mu: Array) -> Array:
    g = np.einsum("nij,ni->nj", J, r)
    blocked = ((x <= arm.lower) & (g > 0)) | ((x >= arm.upper) & (g < 0))
    free = J * ~blocked[:, None, :]
    A = free.transpose(0, 2, 1) @ free
    index = np.arange(x.shape[1])
    A[:, index, index] += mu[:, None]
    delta = -np.linalg.solve(A, (g * ~blocked)[..., None])[..., 0]
    return arm.clip(x + delta * arm.task.steps)


def settled(arm: Bounded, q: Array, rows: Array) -> Array:
    """The same solutions (N, n), with what is left free moved towards the middle of the ranges."""
    task = arm.task
    first = x = unwound(arm, q)
    for _ in range(constants.SETTLINGS):
        r, J = task.seek(x, rows)
        pull = constants.PULL * (task.home - x) / task.steps
        # Least motion from the pull back onto the task: only what the task leaves free remains.
        wanted = r + np.einsum("nij,nj->ni", J, pull)
        delta = pull + task.least_motion(J, wanted)
        x = arm.clip(x + np.clip(delta, -constants.PULL, constants.PULL) * task.steps)
    # At the edge of the reach the free turn has an end: stay with what was found there.
    kept = (task.seek(x, rows)[0] ** 2).sum(axis=1) <= constants.ZERO
    return np.where(kept[:, None], x, first)


def unwound(arm: Bounded, q: Array) -> Array:
    """Postures (N, n) with whole turns taken off where the limits allow it."""
    turns = np.where(arm.task.chain.turning, np.round((q - arm.task.home) / constants.TURN), 0.0)
    less = q - constants.TURN * turns
    return np.where((less >= arm.lower) & (less <= arm.upper), less, q)


def distinct(task: NeedleTask, q: Array) -> Indices:
    """Indices of postures (N, n) of which none repeats another, whole turns aside."""
    turning = task.chain.turning
    kept: list[int] = []
    for i, posture in enumerate(q):
        gaps = (q[kept] - posture) / task.steps
        gaps = np.where(turning, np.abs((gaps + np.pi) % constants.TURN - np.pi), np.abs(gaps))
        if not (gaps.max(axis=1, initial=0.0) < constants.ALIKE).any():
            kept.append(i)
    return np.array(kept, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Tracks:
    """Branches along a sweep."""

    q: Array  # postures (B, K, n) [rad or m]
    reached: Flags  # where the needle is held (B, K)


def follow(arm: Bounded, rows: Array) -> Tracks:
    """Every branch found at the anchors, and at angles that none holds, along rows (K, 7)."""
    K = len(rows)
    found = Tracks(np.empty((0, K, arm.task.chain.n)), np.empty((0, K), dtype=bool))
    for anchor in _spread(K, constants.ANCHORS):
        found = _anchored(arm, rows, anchor, found)
    for _ in range(constants.MORE_ANCHORS):
        reachable = _reachable(arm, rows, np.flatnonzero(~found.reached.any(axis=0)))
        if not len(reachable) or len(found.q) >= constants.MOST_TRACKS:
            break
        before = len(found.q)
        found = _anchored(arm, rows, int(reachable[len(reachable) // 2]), found)
        if len(found.q) == before:
            break
    return found


def _spread(count: int, most: int) -> list[int]:
    """Indices of so many out of ``count`` at most, evenly."""
    return list(dict.fromkeys(np.linspace(0, count - 1, most).round().astype(int).tolist()))


def _anchored(arm: Bounded, rows: Array, anchor: int, known: Tracks) -> Tracks:
    """The tracks with those that start from new branches at one angle."""
    here = np.tile(rows[anchor], (constants.TRACK_STARTS, 1))
    q, found, _ = solved(arm, starts(arm.task, constants.TRACK_STARTS), here)
    if not found.any():
        return known
    q = settled(arm, q[found], here[found])
    old = known.q[:, anchor][known.reached[:, anchor]]
    new = distinct(arm.task, np.vstack([old, q]))
    q = np.vstack([old, q])[new[new >= len(old)]][: constants.MOST_TRACKS - len(known.q)]
    if not len(q):
        return known
    path, held = _both_ways(arm, q, rows, anchor)
    return Tracks(np.vstack([known.q, path]), np.vstack([known.reached, held]))


def _reachable(arm: Bounded, rows: Array, unheld: Indices) -> Indices:
    """Those of some angles that a few starts reach; of many, a few are asked."""
    if not len(unheld):
        return unheld
    some = unheld[_spread(len(unheld), min(constants.ASKED, len(unheld)))]
    q = np.tile(starts(arm.task, constants.FEW_STARTS), (len(some), 1))
    held = solved(arm, q, np.repeat(rows[some], constants.FEW_STARTS, axis=0))[1]
    return some[held.reshape(len(some), -1).any(axis=1)]


def _both_ways(arm: Bounded, q: Array, rows: Array, anchor: int) -> tuple[Array, Flags]:
    K = len(rows)
    path, held = np.empty((len(q), K, q.shape[1])), np.zeros((len(q), K), dtype=bool)
    for order in (range(anchor, K), range(anchor, -1, -1)):
        last, was_held = q, np.ones(len(q), dtype=bool)
        for k in order:
            here = np.tile(rows[k], (len(q), 1))
            x, now = _newton(arm, last, here)
            lost = was_held & ~now
            if lost.any():
                x[lost], now[lost] = _sought(arm, last[lost], here[lost])
            # From where the needle was lost, look for it again from the last good posture.
            last = np.where(now[:, None], x, last)
            path[:, k], held[:, k], was_held = x, now, now
    return path, held


def _newton(arm: Bounded, q: Array, rows: Array) -> tuple[Array, Flags]:
    """Steps of least motion from postures (B, n)."""
    task, x = arm.task, q.copy()
    for left in range(constants.NEWTON_STEPS, -1, -1):
        r, J = task.seek(x, rows)
        held = (r**2).sum(axis=1) <= constants.HELD
        if held.all() or not left:
            break
        delta = task.least_motion(J, r)
        size = np.abs(delta).max(axis=1, keepdims=True)
        delta = delta / np.maximum(1.0, size / constants.LONGEST_STEP)
        x = arm.clip(x + delta * task.steps)
    return x, held


def _sought(arm: Bounded, q: Array, rows: Array) -> tuple[Array, Flags]:
    """Damped steps where Newton's fail, as beside a singularity; far ways off do not count."""
    x, found, _ = solved(arm, q, rows)
    return x, found & (np.abs((x - q) / arm.task.steps).max(axis=1) < 2 * constants.LONGEST_STEP)

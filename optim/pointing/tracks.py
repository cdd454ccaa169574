"""Branches of the inverse kinematics, each followed along a sweep of angles.

An arm reaches a pointing needle in several ways (elbow up or down, wrist flipped); each way that is
found at some anchor angles is followed to both ends by Newton steps of least motion. These tracks
are where the planner starts from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optim.pointing.faults import Array
from optim.pointing.postures import distinct, settled, solved, starts
from optim.pointing.task import NeedleTask

ANCHORS = 3
STARTS = 48
MOST_TRACKS = 12
NEWTON_STEPS = 6
LONGEST_STEP = 0.5  # of one Newton step [rad]
HOLDS = 1e-14


@dataclass(frozen=True, eq=False)
class Tracks:
    """Branches along a sweep.

    Attributes:
        q: Postures (B, K, n) [rad or m].
        reached: Where the needle is held (B, K).
    """

    q: Array
    reached: NDArray[np.bool_]


def follow(task: NeedleTask, rows: Array, lower: Array, upper: Array) -> Tracks:
    """Every branch found at the anchors, followed along the sweep's rows (K, 7)."""
    K, n = len(rows), task.chain.n
    paths, holds = np.empty((0, K, n)), np.empty((0, K), dtype=bool)
    first = starts(task, STARTS)
    for anchor in dict.fromkeys(np.linspace(0, K - 1, ANCHORS).round().astype(int).tolist()):
        here = np.tile(rows[anchor], (STARTS, 1))
        q, found, _ = solved(task, first, here, lower, upper)
        if not found.any():
            continue
        q = settled(task, q[found], here[found], lower, upper)
        known = paths[:, anchor][holds[:, anchor]]
        new = distinct(task, np.vstack([known, q]))
        q = np.vstack([known, q])[new[new >= len(known)]][: MOST_TRACKS - len(paths)]
        if not len(q):
            continue
        path, held = _both_ways(task, q, rows, anchor, lower, upper)
        paths, holds = np.vstack([paths, path]), np.vstack([holds, held])
        if len(paths) >= MOST_TRACKS:
            break
    return Tracks(paths, holds)


def _both_ways(
    task: NeedleTask, q: Array, rows: Array, anchor: int, lower: Array, upper: Array
) -> tuple[Array, NDArray[np.bool_]]:
    K = len(rows)
    path, held = np.empty((len(q), K, q.shape[1])), np.zeros((len(q), K), dtype=bool)
    for order in (range(anchor, K), range(anchor, -1, -1)):
        last, was_held = q, np.ones(len(q), dtype=bool)
        for k in order:
            here = np.tile(rows[k], (len(q), 1))
            x, now = _newton(task, last, here, lower, upper)
            lost = was_held & ~now
            if lost.any():
                x[lost], now[lost] = _sought(task, last[lost], here[lost], lower, upper)
            # From where the needle was lost, look for it again from the last good posture.
            last = np.where(now[:, None], x, last)
            path[:, k], held[:, k], was_held = x, now, now
    return path, held


def _newton(
    task: NeedleTask, q: Array, rows: Array, lower: Array, upper: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Steps of least motion from postures (B, n)."""
    x = q.copy()
    for left in range(NEWTON_STEPS, -1, -1):
        r, J = task.seek(x, rows)
        held = (r**2).sum(axis=1) <= HOLDS
        if held.all() or not left:
            break
        delta = task.least_motion(J, r)
        size = np.abs(delta).max(axis=1, keepdims=True)
        delta = delta * np.minimum(1.0, LONGEST_STEP / np.maximum(size, 1e-12))
        x = np.clip(x + delta * task.steps, lower, upper)
    return x, held


def _sought(
    task: NeedleTask, q: Array, rows: Array, lower: Array, upper: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Damped steps where Newton's fail, as beside a singularity; far ways off do not count."""
    x, found, _ = solved(task, q, rows, lower, upper)
    return x, found & (np.abs((x - q) / task.steps).max(axis=1) < 2 * LONGEST_STEP)

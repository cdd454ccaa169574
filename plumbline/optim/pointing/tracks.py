"""Branches of the inverse kinematics, each followed along a sweep of angles.

An arm reaches a pointing needle in several ways (elbow up or down, wrist flipped); each way that is
found at some anchor angles is followed to both ends by Newton steps of least motion. These tracks
are where the planner starts from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.pointing.constants import (
    ANCHORS,
    ASKED,
    FEW_STARTS,
    HOLDS,
    LONGEST_STEP,
    MORE_ANCHORS,
    MOST_TRACKS,
    NEWTON_STEPS,
    TRACK_STARTS,
)
from plumbline.optim.pointing.postures import distinct, settled, solved, starts
from plumbline.optim.pointing.task import NeedleTask


@dataclass(frozen=True, eq=False)
class Tracks:
    """Branches along a sweep."""

    q: Array  # postures (B, K, n) [rad or m]
    reached: NDArray[np.bool_]  # where the needle is held (B, K)


def follow(task: NeedleTask, rows: Array, lower: Array, upper: Array) -> Tracks:
    """Every branch found at the anchors, and at angles that none holds, along rows (K, 7)."""
    K = len(rows)
    found = Tracks(np.empty((0, K, task.chain.n)), np.empty((0, K), dtype=bool))
    for anchor in dict.fromkeys(np.linspace(0, K - 1, ANCHORS).round().astype(int).tolist()):
        found = _anchored(task, rows, int(anchor), found, lower, upper)
    for _ in range(MORE_ANCHORS):
        unheld = np.flatnonzero(~found.reached.any(axis=0))
        reachable = _reachable(task, rows, unheld, lower, upper)
        if not len(reachable) or len(found.q) >= MOST_TRACKS:
            break
        before = len(found.q)
        found = _anchored(task, rows, int(reachable[len(reachable) // 2]), found, lower, upper)
        if len(found.q) == before:
            break
    return found


def _anchored(
    task: NeedleTask, rows: Array, anchor: int, known: Tracks, lower: Array, upper: Array
) -> Tracks:
    """The tracks with those that start from new branches at one angle."""
    here = np.tile(rows[anchor], (TRACK_STARTS, 1))
    q, found, _ = solved(task, starts(task, TRACK_STARTS), here, lower, upper)
    if not found.any():
        return known
    q = settled(task, q[found], here[found], lower, upper)
    old = known.q[:, anchor][known.reached[:, anchor]]
    new = distinct(task, np.vstack([old, q]))
    q = np.vstack([old, q])[new[new >= len(old)]][: MOST_TRACKS - len(known.q)]
    if not len(q):
        return known
    path, held = _both_ways(task, q, rows, anchor, lower, upper)
    return Tracks(np.vstack([known.q, path]), np.vstack([known.reached, held]))


def _reachable(
    task: NeedleTask, rows: Array, unheld: NDArray[np.intp], lower: Array, upper: Array
) -> NDArray[np.intp]:
    """Those of some angles that a few starts reach; of many, a few are asked."""
    some = unheld[np.linspace(0, len(unheld) - 1, min(ASKED, len(unheld))).round().astype(int)]
    if not len(some):
        return some
    first = starts(task, FEW_STARTS)
    q = np.tile(first, (len(some), 1))
    _, held, _ = solved(task, q, np.repeat(rows[some], FEW_STARTS, axis=0), lower, upper)
    return some[held.reshape(len(some), -1).any(axis=1)]


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

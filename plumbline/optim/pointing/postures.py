r"""Inverse kinematics of many targets at once: where a sweep can start, and whether at all.

Levenberg-Marquardt on all rows together (Madsen, Nielsen, Tingleff 2004, algorithm 3.16); joints
that a step would push out of their range leave it. Starts are a lattice of the generalised golden
ratio (Roberts 2018): every run tries the same ones.

.. math:: x_k = \{ \tfrac12 + k\, (g^{-1}, ..., g^{-n}) \}, \qquad g^{n+1} = g + 1
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.pointing.constants import ITERATIONS, STALLED, TURN, ZERO
from plumbline.optim.pointing.task import NeedleTask


def starts(task: NeedleTask, count: int) -> Array:
    """Postures (count, n) spread over the joints' ranges, of turning ones over one turn at most."""
    n = task.chain.n
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (n + 1))
    shares = (0.5 + np.outer(np.arange(count), ratio ** -np.arange(1, n + 1))) % 1.0
    half = np.where(np.array(task.chain.kinds) == "revolute", np.pi, task.chain.reach)
    low = np.maximum(task.chain.lower, task.home - half)
    high = np.minimum(task.chain.upper, task.home + half)
    return low + shares * (high - low)


def solved(
    task: NeedleTask, q: Array, rows: Array, lower: Array, upper: Array
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Postures (N, n) that hold the needle, which do (N,), and the sums of squares (N,)."""
    x = np.clip(q, lower, upper)
    r, J = task.seek(x, rows)
    cost, mu = (r**2).sum(axis=1), np.full(len(x), 1e-2)
    stalled = np.zeros(len(x), dtype=int)
    for _ in range(ITERATIONS):
        live = np.flatnonzero((cost > ZERO) & (stalled < STALLED))
        if not len(live):
            break
        trial = _step(task, x[live], r[live], J[live], mu[live], lower, upper)
        r_new, J_new = task.seek(trial, rows[live])
        cost_new = (r_new**2).sum(axis=1)
        better = cost_new < cost[live]
        slow = cost_new > 0.999 * cost[live]
        stalled[live] = np.where(slow, stalled[live] + 1, 0)
        mu[live] = np.clip(np.where(better, mu[live] / 5, mu[live] * 4), 1e-12, 1e3)
        taken = live[better]
        x[taken], r[taken], J[taken] = trial[better], r_new[better], J_new[better]
        cost[taken] = cost_new[better]
    return x, cost <= ZERO, cost


def _step(
    task: NeedleTask, x: Array, r: Array, J: Array, mu: Array, lower: Array, upper: Array
) -> Array:
    g = np.einsum("nij,ni->nj", J, r)
    blocked = ((x <= lower) & (g > 0)) | ((x >= upper) & (g < 0))
    free = J * ~blocked[:, None, :]
    A = free.transpose(0, 2, 1) @ free
    index = np.arange(x.shape[1])
    A[:, index, index] += mu[:, None]
    delta = -np.linalg.solve(A, (g * ~blocked)[..., None])[..., 0]
    return np.clip(x + delta * task.steps, lower, upper)


def settled(task: NeedleTask, q: Array, rows: Array, lower: Array, upper: Array) -> Array:
    """The same solutions (N, n), with what is left free moved towards the middle of the ranges."""
    first = x = unwound(task, q, lower, upper)
    for _ in range(15):
        r, J = task.seek(x, rows)
        pull = 0.5 * (task.home - x) / task.steps
        # Least motion from the pull back onto the task: only what the task leaves free remains.
        wanted = r + np.einsum("nij,nj->ni", J, pull)
        delta = pull + task.least_motion(J, wanted)
        x = np.clip(x + np.clip(delta, -0.5, 0.5) * task.steps, lower, upper)
    # At the edge of the reach the free turn has an end: stay with what was found there.
    kept = (task.seek(x, rows)[0] ** 2).sum(axis=1) <= ZERO
    return np.where(kept[:, None], x, first)


def unwound(task: NeedleTask, q: Array, lower: Array, upper: Array) -> Array:
    """Postures (N, n) with whole turns taken off where the limits allow it."""
    turning = np.array(task.chain.kinds) == "revolute"
    turns = np.where(turning, np.round((q - task.home) / TURN), 0.0)
    less = q - TURN * turns
    return np.where((less >= lower) & (less <= upper), less, q)


def distinct(task: NeedleTask, q: Array) -> NDArray[np.intp]:
    """Indices of postures (N, n) of which none repeats another, whole turns aside."""
    turning = np.array(task.chain.kinds) == "revolute"
    kept: list[int] = []
    for i, posture in enumerate(q):
        gaps = (q[kept] - posture) / task.steps
        gaps = np.where(turning, np.abs((gaps + np.pi) % TURN - np.pi), np.abs(gaps))
        if not (gaps.max(axis=1, initial=0.0) < 0.1).any():
            kept.append(i)
    return np.array(kept, dtype=np.intp)

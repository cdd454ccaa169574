r"""The other order of CT's markers that fits the robot's best.

.. math:: \min_{\pi \ne id} \sum_{i < j} \big(|p_{\pi i} - p_{\pi j}| - |q_i - q_j|\big)^2

Distances between markers know no frame, so that all orders are compared before any is fitted. Up to
seven markers every order is tried, beyond that every exchange of two.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from optim.problem import Array
from optim.registration.batch import kabsch_batch

ALL_ORDERS = 7
FITTED = 12  # of the orders with the nearest distances, so many are fitted


@dataclass(frozen=True)
class Relabelling:
    """An order of CT's markers, other than as given.

    Attributes:
        order: CT's marker (from 0) that is the robot's first, second, ...
        misfit: Root mean square misfit of the rigid fit in that order [m].
    """

    order: tuple[int, ...]
    misfit: float


def best_relabelling(ct: Array, robot: Array) -> Relabelling:
    """The best other order of markers (n, 3) [m]."""
    orders = _orders(len(ct))
    apart, wanted = _distances(ct), _distances(robot)
    there = apart[orders[:, :, None], orders[:, None, :]]
    near = np.argsort(np.sum((there - wanted) ** 2, axis=(1, 2)), kind="stable")[:FITTED]
    tried = ct[orders[near]]
    T = kabsch_batch(tried, np.broadcast_to(robot, tried.shape))
    left = tried @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3] - robot
    misfits = np.sqrt(np.mean(np.sum(left**2, axis=2), axis=1))
    best = int(np.argmin(misfits))
    return Relabelling(tuple(int(k) for k in orders[near[best]]), float(misfits[best]))


@lru_cache(maxsize=8)
def _orders(n: int) -> NDArray[np.int64]:
    """Orders (N, n) other than the given one."""
    if n <= ALL_ORDERS:
        return np.array(list(permutations(range(n)))[1:])
    orders = np.tile(np.arange(n), (n * (n - 1) // 2, 1))
    for row, (i, j) in enumerate(combinations(range(n), 2)):
        orders[row, [i, j]] = j, i
    return orders


def _distances(points: Array) -> Array:
    return np.linalg.norm(points[:, None] - points[None], axis=2)

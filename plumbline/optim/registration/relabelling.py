r"""The other order of CT's markers that fits the robot's best.

.. math:: \min_{\pi \ne id} \sum_{i < j} \big(|p_{\pi i} - p_{\pi j}| - |q_i - q_j|\big)^2

Distances between markers know no frame, so that all orders are compared before any is fitted. Up to
seven markers every order is tried, beyond that every exchange of two.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.registration.constants import ALL_ORDERS, FITTED
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True)
class Relabelling:
    """An order of CT's markers, other than as given."""

    order: tuple[int, ...]  # CT's marker (from 0) that is the robot's first, second, ..
    misfit: float  # root mean square misfit of the rigid fit in that order [m]


def best_relabelling(ct: Array, robot: Array) -> Relabelling:
    """The best other order of markers (n, 3) [m]."""
    apart, wanted = _distances(ct), _distances(robot)
    orders = (_any_orders if len(ct) <= ALL_ORDERS else _exchanges)(apart, wanted)
    tried = ct[orders]
    left = misfits(tried, robot)
    best = int(np.argmin(left))
    return Relabelling(tuple(int(k) for k in orders[best]), float(left[best]))


def misfits(ct: Array, robot: Array) -> Array:
    """Root mean square misfits (N,) of the rigid fits of N versions of CT's markers (N, n, 3)."""
    T = rigid_match(ct, np.broadcast_to(robot, ct.shape))
    left = ct @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3] - robot
    rms: Array = np.sqrt(np.mean(np.sum(left**2, axis=2), axis=1))
    return rms


def _any_orders(apart: Array, wanted: Array) -> NDArray[np.intp]:
    """The few orders (N, n), other than the given one, with the nearest distances (n, n)."""
    orders = _orders(len(apart))
    there = apart[orders[:, :, None], orders[:, None, :]]
    cost = np.sum((there - wanted) ** 2, axis=(1, 2))
    return orders[np.argsort(cost, kind="stable")[:FITTED]]


@lru_cache(maxsize=8)
def _orders(n: int) -> NDArray[np.intp]:
    """Orders (N, n) other than the given one."""
    return np.array(list(permutations(range(n)))[1:])


def _exchanges(apart: Array, wanted: Array) -> NDArray[np.intp]:
    r"""The few exchanges of two (N, n) with the nearest distances (n, n).

    An exchange of i and j changes the sum of squares by
    :math:`2 \sum_{k \ne i, j} (D_{ik} - D_{jk})(W_{ik} - W_{jk})`.
    """
    product = apart @ wanted
    own = np.diag(product)
    cost = own[:, None] + own - product - product.T - 2.0 * apart * wanted
    i, j = np.triu_indices(len(apart), 1)
    near = np.argsort(cost[i, j], kind="stable")[:FITTED]
    orders = np.tile(np.arange(len(apart)), (len(near), 1))
    rows = np.arange(len(near))
    orders[rows, i[near]], orders[rows, j[near]] = j[near], i[near]
    return orders


def _distances(points: Array) -> Array:
    return np.linalg.norm(points[:, None] - points[None], axis=2)

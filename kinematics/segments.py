r"""Many pairs of segments at once, in NumPy: the arithmetic of :mod:`kinematics.capsules`.

.. math:: d = |p(s) - q(t)|, \qquad n = (p(s) - q(t)) / d

A real-time loop asks about a few hundred pairs, another number at every step, so it asks here; the
tests hold symbols, arrays and coal together. The normal n separates the two segments; where they
touch or cross it is the common normal of their axes, and where that vanishes too any normal of one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.capsules import PARALLEL, TINY

Array = NDArray[np.float64]
TOUCHING = 1e-9  # [length] below which the direction between nearest points means nothing


@dataclass(frozen=True)
class Nearest:
    """Nearest points of N pairs of segments.

    Attributes:
        distance: Distances (N,) of the axes, never negative.
        difference: From the point on the second to the point on the first (N, 3).
        share_one: Where on the first (N,), 0 at its first end and 1 at its second.
        share_two: Where on the second (N,).
    """

    distance: Array
    difference: Array
    share_one: Array
    share_two: Array


def nearest(one: ArrayLike, two: ArrayLike) -> Nearest:
    """Nearest points of pairs of segments.

    Args:
        one: Ends (N, 2, 3).
        two: Ends (N, 2, 3).
    """
    first, second = np.asarray(one, dtype=float), np.asarray(two, dtype=float)
    p, q = first[:, 0], second[:, 0]
    u, v, r = first[:, 1] - p, second[:, 1] - q, p - q
    a, e = np.vecdot(u, u) + TINY, np.vecdot(v, v) + TINY
    b, c, f = np.vecdot(u, v), np.vecdot(u, r), np.vecdot(v, r)
    ae = a * e
    determinant = np.maximum(ae - b * b, PARALLEL * ae + TINY)
    s = _clamp((b * f - c * e) / determinant)
    t = _clamp((b * s + f) / e)
    s = _clamp((b * t - c) / a)
    difference = r + s[:, None] * u - t[:, None] * v
    return Nearest(np.sqrt(np.vecdot(difference, difference)), difference, s, t)


def separating_normals(one: ArrayLike, two: ArrayLike) -> tuple[Array, Array]:
    """Unit normals (N, 3) that point from the second segment to the first, and distances (N,).

    Args:
        one: Ends (N, 2, 3).
        two: Ends (N, 2, 3).
    """
    found = nearest(one, two)
    touching = found.distance < TOUCHING
    normals = found.difference / np.where(touching, 1.0, found.distance)[:, None]
    if touching.any():
        first, second = np.asarray(one, dtype=float), np.asarray(two, dtype=float)
        normals[touching] = _common_normals(first[touching], second[touching])
    return normals, found.distance


def _clamp(values: Array) -> Array:
    return np.minimum(np.maximum(values, 0.0), 1.0)


def _common_normals(one: Array, two: Array) -> Array:
    u, v = one[:, 1] - one[:, 0], two[:, 1] - two[:, 0]
    longer = np.where((np.vecdot(u, u) >= np.vecdot(v, v))[:, None], u, v)
    axis = np.eye(3)[np.argmin(np.abs(longer), axis=1)]
    normals = np.cross(u, v)
    size = np.linalg.norm(normals, axis=1)
    parallel = size <= 1e-9 * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1) + TINY
    normals[parallel] = np.cross(longer[parallel], axis[parallel])
    size = np.linalg.norm(normals, axis=1)
    normals[size < TINY] = [0.0, 0.0, 1.0]
    return normals / np.maximum(size, TINY)[:, None]

r"""Many pairs of segments at once, in NumPy: the arithmetic of :mod:`.capsules`.

.. math:: d = |p(s) - q(t)|, \qquad n = (p(s) - q(t)) / d

For callers with many pairs, another number each time; the tests hold symbols, arrays and coal
together. Unless the two segments touch, the normal n separates them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from plumbline.kinematics.capsules import PARALLEL, TINY
from plumbline.kinematics.evaluate import Array


@dataclass(frozen=True)
class Nearest:
    """Nearest points of N pairs of segments."""

    distance: Array  # distances (N,) of the axes, never negative
    difference: Array  # from the point on the second to the point on the first (N, 3)
    share_one: Array  # where on the first (N,), 0 at its first end and 1 at its second
    share_two: Array  # where on the second (N,)


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


def _clamp(values: Array) -> Array:
    return np.minimum(np.maximum(values, 0.0), 1.0)

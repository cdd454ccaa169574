r"""How true rebuilt points are against another instrument: FRE and TRE, leaving one out.

.. math:: FRE = \sqrt{\tfrac1n \sum_i |R p_i + t - q_i|^2}, \qquad
          TRE_i = |R_{-i}\, p_i + t_{-i} - q_i|

with the rigid fit of all points, and of all points but i (Fitzpatrick, West, Maurer 1998). TRE so
measured contains the left-out point's own two errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.constants import LEAST_POINTS
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of rebuilt points against another instrument's."""

    fre: float  # root mean square of the fit's residuals [m]
    tre: Array  # error of each point, left out of the fit (n,) [m]
    T: Array  # the fit of all points (4, 4): from the first instrument's frame to the second's


def leave_one_out(points: Array, others: Array) -> Accuracy:
    """FRE of all, and TRE of each left out.

    Args:
        points: Rebuilt points (n, 3) in the base frame [m].
        others: The same points by the other instrument (n, 3), in its frame [m].

    Raises:
        PlumblineError: Fewer than four points, or shapes that differ.
    """
    if points.shape != others.shape or points.ndim != 2 or len(points) < LEAST_POINTS:
        raise PlumblineError(
            f"points {points.shape} and {others.shape}, two of (n, 3) with n >= {LEAST_POINTS} "
            "expected; give the same points by both instruments, row by row"
        )
    T = rigid_match(points, others)
    rest = np.array([np.delete(np.arange(len(points)), i) for i in range(len(points))])
    without = rigid_match(points[rest], others[rest])
    gaps = np.einsum("nij,nj->ni", without[:, :3, :3], points) + without[:, :3, 3] - others
    return Accuracy(_rms(moved(T, points) - others), np.linalg.norm(gaps, axis=1), T)


def moved(T: Array, points: Array) -> Array:
    """Points (N, 3) [m] carried by a transform (4, 4)."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _rms(gaps: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(gaps**2, axis=1))))

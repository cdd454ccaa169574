r"""The principal plane of points: through their mean, across the direction of least spread.

.. math:: \min_{|n| = 1}\ \sum_i (n^T (x_i - \bar x))^2

Where points may be gross, a start is the plane through three of them whose median distance from all
is least (LMedS: Rousseeuw 1984), over random threes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.constants import THREES


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in space."""

    normal: Array  # unit normal (3,)
    centre: Array  # A point of it (3,) [m]

    def distances(self, points: Array) -> Array:
        """Signed distances (N,) of points (N, 3) [m]."""
        return np.asarray((points - self.centre) @ self.normal)

    def angle_to(self, other: Plane) -> float:
        """Angle between the planes [rad], 0 to 90 deg."""
        sine = np.linalg.norm(np.cross(self.normal, other.normal))
        return float(np.arctan2(sine, abs(self.normal @ other.normal)))


def principal_plane(points: Array) -> Plane:
    """The plane that lies nearest to points (N, 3) [m]; the sign of its normal is arbitrary."""
    centre = points.mean(axis=0)
    _, vectors = np.linalg.eigh((points - centre).T @ (points - centre))
    return Plane(vectors[:, 0], centre)


def least_median_plane(points: Array) -> Plane:
    """The plane through three of the points (N, 3) whose median distance [m] from all is least.

    It is refitted to the nearer half of the points. The threes are the same in every run.
    """
    rng = np.random.default_rng(len(points))
    a, b, c = points[rng.integers(0, len(points), (3, THREES))]
    normals = np.cross(b - a, c - a)
    size = np.linalg.norm(normals, axis=1)
    wide = size > 1e-12
    if not wide.any():
        return principal_plane(points)
    normals, a = normals[wide] / size[wide, None], a[wide]
    gaps = np.abs(points @ normals.T - np.sum(a * normals, axis=1))
    best = int(np.argmin(np.median(gaps, axis=0)))
    near = gaps[:, best] <= np.median(gaps[:, best])
    return principal_plane(points[near]) if near.sum() > 3 else principal_plane(points)

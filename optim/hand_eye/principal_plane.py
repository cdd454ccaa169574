r"""The principal plane of points: through their mean, across the direction of least spread.

.. math:: \min_{|n| = 1}\ \sum_i (n^T (x_i - \bar x))^2
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optim.hand_eye.beam import Array


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in space.

    Attributes:
        normal: Unit normal (3,).
        centre: A point of it (3,) [m].
    """

    normal: Array
    centre: Array

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

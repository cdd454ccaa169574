r"""The unknown of the calibration: where the beam starts on the flange, and where it points.

.. math:: x_b = R\,(r + d\,v) + t, \qquad |v| = 1,\ v_z > 0

(R, t) is the flange in the base frame, d the range read (Zeng et al. 2017, eqs. 1-4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from plumbline.optim.core.problem import Array


@dataclass(frozen=True, eq=False)
class Beam:
    """A range finder's beam in the flange frame."""

    r: Array  # its origin (3,) [m]
    v: Array  # its unit direction (3,)

    @classmethod
    def of(cls, r: ArrayLike, v: ArrayLike) -> Beam:
        """From an origin (3,) [m] and a direction (3,) of any length."""
        direction = np.asarray(v, dtype=float)
        return cls(np.asarray(r, dtype=float), direction / np.linalg.norm(direction))

    def points(self, R: Array, t: Array, distance: Array) -> Array:
        """Rebuilt points (N, 3) [m] of flange poses (N, 3, 3), (N, 3) [m] and ranges (N,) [m]."""
        seen = self.r + distance[:, None] * self.v
        return np.asarray(np.einsum("nij,nj->ni", R, seen) + t)

    def angle_to(self, other: Beam) -> float:
        """Angle between the two directions [rad]."""
        sine = np.linalg.norm(np.cross(self.v, other.v))
        return float(np.arctan2(sine, self.v @ other.v))

    def error_at(self, truth: Beam, distance: float) -> float:
        """How far a point rebuilt at that range [m] lies from the truth [m]."""
        gap = self.r - truth.r + distance * (self.v - truth.v)
        return float(np.linalg.norm(gap))


def mean_beam(beams: list[Beam]) -> Beam:
    """The mean of several results: of the origins, and of the directions, normalised."""
    return Beam.of(np.mean([b.r for b in beams], axis=0), np.mean([b.v for b in beams], axis=0))

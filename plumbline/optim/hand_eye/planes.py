r"""Principal planes of points, and readings as rows of numbers, each plane in a frame of its own.

.. math:: \min_{|n| = 1}\ \sum_i (n^T (x_i - \bar x))^2

Where points may be gross, a start is the plane through three of them whose median distance from all
is least (LMedS: Rousseeuw 1984), over random threes. With B_k a rotation whose third column is near
plane k's normal, and c_k a point near it, every reading is carried into the plane's frame once,

.. math:: R' = B_k^T R\, F, \qquad t' = B_k^T (t - c_k),

where the normal is a small slope (a, b): :math:`\nu = (a, b, 1) / |(a, b, 1)|`. F is a rotation
whose third column is near the beam, so that v is a small slope too, wherever on the flange the
finder looks; the unknown origin is then :math:`r' = F^T r`. So one symbolic statement serves every
recording, and is compiled once; the signs of normals and beam are settled by B_k and F.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye.constants import THREES
from plumbline.optim.hand_eye.readings import Beam, Readings


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
    """The plane of least median distance through three of the points (N, 3), refitted to half."""
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


@dataclass(frozen=True, eq=False)
class Frames:
    """A frame for each plane, and one for the beam."""

    B: Array  # orientations (K, 3, 3) in the base frame; third column along the beams' sense
    c: Array  # origins (K, 3) in the base frame [m]
    F: Array  # orientation (3, 3) of the finder's frame on the flange; third column near the beam

    @classmethod
    def of(cls, readings: Readings, beam: Beam) -> Frames:
        """Frames on the planes of least median of the points that a beam makes of the readings."""
        points = beam.points(readings.R, readings.t, readings.distance)
        ways = readings.R @ beam.v
        planes = [least_median_plane(points[readings.plane == k]) for k in readings.planes]
        senses = [ways[readings.plane == k].mean(axis=0) for k in readings.planes]
        signs = [np.sign(p.normal @ s) or 1.0 for p, s in zip(planes, senses, strict=True)]
        normals = [p.normal * s for p, s in zip(planes, signs, strict=True)]
        B, c = np.array([_basis(n) for n in normals]), np.array([p.centre for p in planes])
        return cls(B, c, _basis(beam.v))

    def index(self, readings: Readings) -> NDArray[np.intp]:
        """Which frame each reading belongs to (N,), from 0."""
        return np.asarray(np.searchsorted(readings.planes, readings.plane))

    def carried(self, readings: Readings) -> tuple[Array, Array]:
        """Orientations of the finder (N, 3, 3) and positions (N, 3) in the planes' frames."""
        k = self.index(readings)
        turned = np.swapaxes(self.B[k], 1, 2)
        return turned @ readings.R @ self.F, np.einsum("nij,nj->ni", turned, readings.t - self.c[k])

    def of_beam(self, beam: Beam) -> Array:
        """The unknowns (5,) of a beam: its origin [m] and slope in the finder's frame."""
        v = self.F.T @ beam.v
        return np.concatenate([self.F.T @ beam.r, v[:2] / v[2]])

    def beam(self, x: Array) -> Beam:
        """The beam on the flange, of unknowns whose first five are those of :meth:`of_beam`."""
        return Beam.of(self.F @ x[:3], self.F @ np.append(x[3:5], 1.0))

    def plane(self, k: int, slope: Array, offset: float) -> Plane:
        """Plane k in the base frame, of slope (2,) and offset [m] in its own frame."""
        nu = np.append(slope, 1.0) / np.sqrt(1.0 + slope @ slope)
        return Plane(self.B[k] @ nu, self.c[k] - offset * self.B[k] @ nu)


def _basis(normal: Array) -> Array:
    """A rotation (3, 3) whose third column is a unit normal (3,)."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first), normal])


def unit(slope: cs.SX) -> cs.SX:
    """The unit vector (3,) of a slope (2,): of the half-sphere whose z is positive."""
    v = cs.vertcat(slope[0], slope[1], 1)
    return v / cs.sqrt(cs.sumsqr(v))


def marks_of_planes(index: NDArray[np.intp], count: int) -> Array:
    """One column a plane (N, K), 1 where the row is the plane's."""
    return np.asarray(np.eye(count)[index])

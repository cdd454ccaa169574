r"""A beam on a flange, the unknown of the calibration, and readings of it on planes.

.. math:: x_b = R\,(r + d\,v) + t, \qquad |v| = 1,\ v_z > 0

(R, t) is the flange in the base frame, d the range read (Zeng et al. 2017, eqs. 1-4).
``Readings.from_arrays(R, t, distance, plane, motion)`` checks what it is given: units, finiteness,
rotations, enough rows.

Principal planes of points, and readings as rows of numbers, each plane in a frame of its own.

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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Array, Flags, Indices, Integers
from plumbline.optim.hand_eye import constants
from plumbline.optim.rigid import basis


@dataclass(frozen=True, eq=False)
class Beam:
    """A range finder's beam in the flange frame."""

    r: Array  # its origin (3,) [m]
    v: Array  # its unit direction (3,)

    @classmethod
    def of(cls, r: ArrayLike, v: ArrayLike) -> Self:
        """From an origin (3,) [m] and a direction (3,) of any length."""
        direction = np.asarray(v, dtype=float)
        return cls(np.asarray(r, dtype=float), direction / np.linalg.norm(direction))

    def points(self, R: Array, t: Array, distance: Array) -> Array:
        """Rebuilt points (N, 3) [m] of flange poses (N, 3, 3), (N, 3) [m] and ranges (N,) [m]."""
        seen = self.r + distance[:, None] * self.v
        return np.asarray(np.einsum("nij,nj->ni", R, seen) + t)

    def angle_to(self, other: Self) -> float:
        """Angle between the two directions [rad]."""
        sine = np.linalg.norm(np.cross(self.v, other.v))
        return float(np.arctan2(sine, self.v @ other.v))

    def error_at(self, truth: Self, distance: float) -> float:
        """How far a point rebuilt at that range [m] lies from the truth [m]."""
        gap = self.r - truth.r + distance * (self.v - truth.v)
        return float(np.linalg.norm(gap))


def mean_beam(beams: list[Beam]) -> Beam:
    """The mean of several results: of the origins, and of the directions, normalised."""
    return Beam.of(np.mean([b.r for b in beams], axis=0), np.mean([b.v for b in beams], axis=0))


@dataclass(frozen=True, eq=False)
class Readings:
    """N readings; arrays in SI units, base frame."""

    R: Array  # orientations of the flange (N, 3, 3)
    t: Array  # positions of the flange (N, 3) [m]
    distance: Array  # ranges read (N,) [m]
    plane: Integers  # plane of each reading (N,), any whole numbers
    motion: Integers  # group of motions of each reading (N,), any whole numbers
    row: Integers  # what each reading is called, to name it in a report (N,)

    @classmethod
    def from_arrays(
        cls,
        R: ArrayLike,
        t: ArrayLike,
        distance: ArrayLike,
        plane: ArrayLike | None = None,
        motion: ArrayLike | None = None,
        row: ArrayLike | None = None,
    ) -> Self:
        """Checked readings; one plane, one motion and rows from 0 unless given."""
        ranges = np.asarray(distance, dtype=float)
        count = len(ranges) if ranges.ndim == 1 else -1
        given = [np.zeros(count) if k is None else np.asarray(k) for k in (plane, motion)]
        given.append(np.arange(count) if row is None else np.asarray(row))
        at, place = (np.asarray(values, dtype=float) for values in (R, t))
        made = cls(at, place, ranges, *(k.astype(np.int64) for k in given))
        _check(made, count)
        return made

    def __len__(self) -> int:
        return len(self.distance)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Several readings as one."""
        columns = zip(*(vars(p).values() for p in parts), strict=True)
        return cls(*map(np.concatenate, columns))

    @property
    def planes(self) -> Integers:
        """The planes, in ascending order (K,)."""
        return np.unique(self.plane)

    def select(self, rows: Flags | Indices) -> Self:
        """Some of the readings: a mask (N,), or indices."""
        return type(self)(**{name: values[rows] for name, values in vars(self).items()})

    def on_plane(self, plane: int) -> Self:
        """The readings of one plane."""
        return self.select(self.plane == plane)

    def motions(self) -> Iterator[Self]:
        """The readings of each group of motions, in order of their numbers."""
        for motion in np.unique(self.motion):
            yield self.select(self.motion == motion)

    @property
    def rows(self) -> Array:
        """Poses, their rotations column by column as CasADi has them, and ranges (N, 13)."""
        R = np.swapaxes(self.R, 1, 2).reshape(-1, 9)
        return np.hstack([R, self.t, self.distance[:, None]])

    def turns(self) -> Array:
        """Angle (N,) between each orientation and the first [rad]."""
        # From the chord: exact for small angles, where the arc cosine of the trace is not.
        chord = np.linalg.norm(self.R - self.R[0], axis=(1, 2)) / np.sqrt(8.0)
        return np.asarray(2.0 * np.arcsin(np.clip(chord, 0.0, 1.0)))

    @property
    def distinct(self) -> int:
        """How many different poses there are: a repeated one tells of the noise alone."""
        poses = np.hstack([self.t, self.R.reshape(-1, 9)])
        return len(np.unique(np.round(poses / constants.SAME_POSE), axis=0))

    @property
    def is_translation(self) -> bool:
        """Whether all orientations agree."""
        # Entries move by the angle at most: most groups that turn are told without an arc sine.
        if np.max(np.abs(self.R - self.R[0])) > constants.SAME_TURN:
            return False
        return bool(np.all(self.turns() < constants.SAME_TURN))


def _check(readings: Readings, count: int) -> None:
    r = readings
    shapes = {"R": (3, 3), "t": (3,), "distance": (), "plane": (), "motion": ()}
    for name, own in shapes.items():
        found, wanted = getattr(r, name).shape, (count, *own)
        if found != wanted:
            raise PlumblineError(f"{name}: shape {found}, expected {wanted}; give one entry a row")
    if count < constants.LEAST_ROWS:
        raise PlumblineError(
            f"{count} readings, at least {constants.LEAST_ROWS} expected; take more"
        )
    for name in ("R", "t", "distance"):
        values = getattr(r, name).reshape(count, -1)
        broken = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(broken):
            raise PlumblineError(
                f"{name}: row {r.row[broken[0]]} is not finite, a number expected; mend or delete "
                "the row"
            )
    _check_units(r)
    slack = np.abs(r.R @ np.swapaxes(r.R, 1, 2) - np.eye(3)).max(axis=(1, 2))
    broken = np.flatnonzero((slack > constants.SKEWED) | (np.linalg.det(r.R) < 0))
    if len(broken):
        raise PlumblineError(
            f"R: row {r.row[broken[0]]} is no rotation matrix (|R R^T - 1| = {slack[broken[0]]:.2g}"
            f", {constants.SKEWED:g} allowed); give orientations of the flange in the base frame"
        )


def _check_units(r: Readings) -> None:
    for name, sizes in (("distance", np.abs(r.distance)), ("t", np.linalg.norm(r.t, axis=1))):
        middle = float(np.median(sizes))
        if middle > constants.LONGEST:
            raise PlumblineError(
                f"{name}: median {middle:.4g}, at most {constants.LONGEST:g} m expected; it looks "
                "like millimetres: divide by 1000"
            )
    if np.any(r.distance <= 0.0):
        worst = int(np.argmin(r.distance))
        raise PlumblineError(
            f"distance: {r.distance[worst]:.4g} m in row {r.row[worst]}, more than 0 expected; "
            "delete readings without an echo"
        )


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in space."""

    normal: Array  # unit normal (3,)
    centre: Array  # A point of it (3,) [m]

    def distances(self, points: Array) -> Array:
        """Signed distances (N,) of points (N, 3) [m]."""
        return np.asarray((points - self.centre) @ self.normal)

    def angle_to(self, other: Self) -> float:
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
    a, b, c = points[rng.integers(0, len(points), (3, constants.THREES))]
    normals = np.cross(b - a, c - a)
    size = np.linalg.norm(normals, axis=1)
    wide = size > constants.VANISHING
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
    def of(cls, readings: Readings, beam: Beam) -> Self:
        """Frames on the planes of least median of the points that a beam makes of the readings."""
        points = beam.points(readings.R, readings.t, readings.distance)
        ways = readings.R @ beam.v
        planes = [least_median_plane(points[readings.plane == k]) for k in readings.planes]
        senses = [ways[readings.plane == k].mean(axis=0) for k in readings.planes]
        signs = [np.sign(p.normal @ s) or 1.0 for p, s in zip(planes, senses, strict=True)]
        normals = [p.normal * s for p, s in zip(planes, signs, strict=True)]
        B, c = np.array([basis(n) for n in normals]), np.array([p.centre for p in planes])
        return cls(B, c, basis(beam.v))

    def index(self, readings: Readings) -> Indices:
        """Which frame each reading belongs to (N,), from 0."""
        return np.asarray(np.searchsorted(readings.planes, readings.plane))

    def carried(self, readings: Readings, index: Indices | None = None) -> Readings:
        """Readings of the finder in the frames of their planes, or of other ones (N,)."""
        k = self.index(readings) if index is None else index
        turned = np.swapaxes(self.B[k], 1, 2)
        t = np.einsum("nij,nj->ni", turned, readings.t - self.c[k])
        return replace(readings, R=turned @ readings.R @ self.F, t=t)

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


def unit(slope: cs.SX) -> cs.SX:
    """The unit vector (3,) of a slope (2,): of the half-sphere whose z is positive."""
    v = cs.vertcat(slope[0], slope[1], 1)
    return v / cs.sqrt(cs.sumsqr(v))


def marks_of_planes(index: Indices, count: int) -> Array:
    """One column a plane (N, K), 1 where the row is the plane's."""
    return np.asarray(np.eye(count)[index])

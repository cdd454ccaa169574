r"""A beam on a flange, the unknown of the calibration, and readings of it on planes.

.. math:: x_b = R\,(r + d\,v) + t, \qquad |v| = 1,\ v_z > 0

(R, t) is the flange in the base frame, d the range read (Zeng et al. 2017, eqs. 1-4).
``Readings.from_arrays(R, t, distance, plane, motion)`` checks what it is given: units, finiteness,
rotations, enough rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye.constants import LEAST_ROWS, LONGEST, SAME_POSE, SAME_TURN, SKEWED


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


Integers = NDArray[np.int64]


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
    ) -> Readings:
        """Checked readings; one plane, one motion and rows from 0 unless given."""
        ranges = np.asarray(distance, dtype=float)
        count = len(ranges) if ranges.ndim == 1 else -1
        given = [np.zeros(count) if k is None else np.asarray(k) for k in (plane, motion)]
        rows = np.arange(count) if row is None else np.asarray(row)
        made = cls(
            np.asarray(R, dtype=float),
            np.asarray(t, dtype=float),
            ranges,
            *(k.astype(np.int64) for k in (*given, rows)),
        )
        _check(made, count)
        return made

    def __len__(self) -> int:
        return len(self.distance)

    @classmethod
    def joined(cls, parts: Sequence[Readings]) -> Readings:
        """Several readings as one."""
        names = ("R", "t", "distance", "plane", "motion", "row")
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))

    @property
    def planes(self) -> Integers:
        """The planes, in ascending order (K,)."""
        return np.unique(self.plane)

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Readings:
        """Some of the readings: a mask (N,), or indices."""
        names = ("R", "t", "distance", "plane", "motion", "row")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def on_plane(self, plane: int) -> Readings:
        """The readings of one plane."""
        return self.select(self.plane == plane)

    def motions(self) -> Iterator[Readings]:
        """The readings of each group of motions, in order of their numbers."""
        for motion in np.unique(self.motion):
            yield self.select(self.motion == motion)

    def turns(self) -> Array:
        """Angle (N,) between each orientation and the first [rad]."""
        return turn_angles(self.R[0], self.R)

    @property
    def distinct(self) -> int:
        """How many different poses there are: a repeated one tells of the noise alone."""
        poses = np.hstack([self.t, self.R.reshape(-1, 9)])
        return len(np.unique(np.round(poses / SAME_POSE), axis=0))

    @property
    def is_translation(self) -> bool:
        """Whether all orientations agree."""
        # Entries move by the angle at most: most groups that turn are told without an arc sine.
        if np.max(np.abs(self.R - self.R[0])) > SAME_TURN:
            return False
        return bool(np.all(self.turns() < SAME_TURN))


def turn_angles(one: Array, others: Array) -> Array:
    """Angles (N,) [rad] of the rotations between one orientation (3, 3) and others (N, 3, 3)."""
    # From the chord: exact for small angles, where the arc cosine of the trace is not.
    chord = np.linalg.norm(others - one, axis=(1, 2)) / np.sqrt(8.0)
    return np.asarray(2.0 * np.arcsin(np.clip(chord, 0.0, 1.0)))


def _check(readings: Readings, count: int) -> None:
    r = readings
    shapes = {
        "R": (r.R.shape, (count, 3, 3)),
        "t": (r.t.shape, (count, 3)),
        "distance": (r.distance.shape, (count,)),
        "plane": (r.plane.shape, (count,)),
        "motion": (r.motion.shape, (count,)),
    }
    for name, (found, wanted) in shapes.items():
        if found != wanted:
            raise PlumblineError(f"{name}: shape {found}, expected {wanted}; give one entry a row")
    if count < LEAST_ROWS:
        raise PlumblineError(f"{count} readings, at least {LEAST_ROWS} expected; take more")
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
    broken = np.flatnonzero((slack > SKEWED) | (np.linalg.det(r.R) < 0))
    if len(broken):
        raise PlumblineError(
            f"R: row {r.row[broken[0]]} is no rotation matrix (|R R^T - 1| = {slack[broken[0]]:.2g}"
            f", {SKEWED:g} allowed); give orientations of the flange in the base frame"
        )


def _check_units(r: Readings) -> None:
    for name, sizes in (("distance", np.abs(r.distance)), ("t", np.linalg.norm(r.t, axis=1))):
        middle = float(np.median(sizes))
        if middle > LONGEST:
            raise PlumblineError(
                f"{name}: median {middle:.4g}, at most {LONGEST:g} m expected; it looks like "
                "millimetres: divide by 1000"
            )
    if np.any(r.distance <= 0.0):
        worst = int(np.argmin(r.distance))
        raise PlumblineError(
            f"distance: {r.distance[worst]:.4g} m in row {r.row[worst]}, more than 0 expected; "
            "delete readings without an echo"
        )

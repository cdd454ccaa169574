r"""The direct statement: every reading an equation of its own (Zeng et al. 2017, eq. 5).

.. math:: e_j = n_k^T \big(R_j (r + d_j v) + t_j\big) + b_k - h_k(j), \qquad
          \min \sum_j \frac{e_j^2}{\sigma_j^2} + \sum_{k, m} \frac{c_{km}^2}{s^2}

No pose is a reference, no group is special, planes are free of each other and any number will do.
h is how far the board stands out of its plane where the reading lies, a sum of smooth shapes c phi
(:mod:`optim.hand_eye.bow`) that shrink to zero where the readings do not ask for them. The
variances are those of :mod:`optim.hand_eye.variance`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as cs
import numpy as np

from optim.hand_eye.beam import Array, Beam
from optim.hand_eye.principal_plane import Plane
from optim.hand_eye.readings import Readings
from optim.hand_eye.rows import Frames, marks_of_planes, unit
from optim.problem import Problem

SIZES = (1e-2, 1e-1, 1e-1, 1e-2, 1e-4)  # r [m], v, normals, offsets [m], shapes [m]


@dataclass(frozen=True, eq=False)
class Symbols:
    """The statement for K planes of M shapes each, before any data.

    Attributes:
        x: Unknowns: r, slope of v, slopes of the normals, offsets, shapes.
        row: R' (9), t' (3), d, 1 for a reading, planes (K), shapes (M).
        residual: Distance from the board [m], or the shape's coefficient for a row of the prior.
        planes: K.
        shapes: M.
    """

    x: cs.SX
    row: cs.SX
    residual: cs.SX
    planes: int
    shapes: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        k, m = range(1, self.planes + 1), range(1, self.shapes + 1)
        beam = ("r_x", "r_y", "r_z", "v_x", "v_y")
        normals = (f"n{i}_{a}" for i in k for a in "xy")
        shapes = (f"h{i}_{j}" for i in k for j in m)
        return (*beam, *normals, *(f"b{i}" for i in k), *shapes)

    def scale(self) -> Array:
        """Typical sizes of the unknowns."""
        counts = (3, 2, 2 * self.planes, self.planes, self.planes * self.shapes)
        return np.repeat(SIZES, counts)


@lru_cache(maxsize=16)
def symbols(planes: int, shapes: int) -> Symbols:
    """The statement for that many planes and shapes, written once."""
    r, v = cs.SX.sym("r", 3), cs.SX.sym("v", 2)
    n, b = cs.SX.sym("n", 2, planes), cs.SX.sym("b", planes)
    c = cs.SX.sym("c", shapes, planes)
    row = cs.SX.sym("row", 14 + planes + shapes)
    R, t = cs.reshape(row[:9], 3, 3), row[9:12]
    distance, real = row[12], row[13]
    chosen, phi = row[14 : 14 + planes], row[14 + planes :]
    point = R @ (r + distance * unit(v)) + t
    height = cs.dot(unit(n @ chosen), point) + cs.dot(chosen, b)
    bow = cs.dot(phi, c @ chosen) if shapes else 0
    x = cs.vertcat(r, v, cs.vec(n), b, cs.vec(c))
    return Symbols(x, row, real * height - bow, planes, shapes)


def state(readings: Readings, frames: Frames, shapes: Array | None = None) -> Problem:
    """The problem of some readings, all weights 1; rows of the prior come after the readings.

    Args:
        readings: N readings of K planes.
        frames: The planes' frames.
        shapes: Values of M unit shapes at the readings (N, M); none by default.
    """
    phi = np.empty((len(readings), 0)) if shapes is None else shapes
    count = len(frames.c)
    s = symbols(count, phi.shape[1])
    R, t = frames.carried(readings)
    rows = np.hstack(
        [
            np.swapaxes(R, 1, 2).reshape(-1, 9),  # column by column, as CasADi has it
            t,
            readings.distance[:, None],
            np.ones((len(readings), 1)),
            marks_of_planes(frames.index(readings), count),
            phi,
        ]
    )
    rows = np.concatenate([rows, _prior_rows(count, phi.shape[1])])
    limit = np.full(s.x.numel(), np.inf)
    return Problem(
        x=s.x, names=s.names, lower=-limit, upper=limit, scale=s.scale(),
        residual=s.residual, row=s.row, rows=rows, weights=np.ones(len(rows)),
    )  # fmt: skip


def _prior_rows(planes: int, shapes: int) -> Array:
    """One row for each shape of each plane: its coefficient, to be pulled to zero."""
    rows = np.zeros((planes * shapes, 14 + planes + shapes))
    at = np.arange(len(rows))
    if len(rows):
        rows[at, 14 + at // shapes] = 1.0
        rows[at, 14 + planes + at % shapes] = 1.0
    return rows


def start(beam: Beam, frames: Frames, shapes: int = 0) -> Array:
    """The unknowns at a beam whose planes are the frames."""
    planes = len(frames.c)
    return np.concatenate([frames.of_beam(beam), np.zeros(3 * planes + planes * shapes)])


def planes_of(x: Array, frames: Frames) -> tuple[Plane, ...]:
    """The planes at a point, in the base frame."""
    count = len(frames.c)
    slopes = x[5 : 5 + 2 * count].reshape(count, 2)
    offsets = x[5 + 2 * count : 5 + 3 * count]
    return tuple(frames.plane(k, slopes[k], offsets[k]) for k in range(count))


def beam_covariance(covariance: Array, x: Array, frames: Frames) -> Array:
    """Covariance (6, 6) of (r [m], v) on the flange from that of the first five unknowns (5, 5)."""
    a, b = x[3:5]
    length = np.sqrt(1.0 + a * a + b * b)
    v = np.array([a, b, 1.0]) / length
    turn = (np.eye(3)[:, :2] - np.outer(v, v[:2])) / length
    J = np.zeros((6, 5))
    J[:3, :3], J[3:, 3:] = frames.F, frames.F @ turn
    return np.asarray(J @ covariance @ J.T)


def incidence(readings: Readings, beam: Beam, planes: tuple[Plane, ...]) -> Array:
    """Angle (N,) [rad] between each reading's beam and its plane's normal."""
    ways = readings.R @ beam.v
    index = np.searchsorted(readings.planes, readings.plane)
    normals = np.array([plane.normal for plane in planes])[index]
    return np.asarray(np.arccos(np.clip(np.abs(np.sum(ways * normals, axis=1)), 0.0, 1.0)))

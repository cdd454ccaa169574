r"""The joint problem on several planes with the coplanarity penalty (Zeng et al. 2017, eqs. 16-18).

.. math:: \min\ \sum_k \sum_{groups} \alpha\, |n + g\,p|^2 + \beta \sum |X - X_{fit}|^2, \qquad
          p = n^T v,\ |n| = |v| = 1,\ n_z > 0

g is the slope of a group of pure translations (:mod:`plumbline.optim.hand_eye.single_plane`), X are
all rebuilt points of plane k and X_fit their projections on their own principal plane. That plane
is the one that minimises the distances, so it becomes an unknown beside the others: a plane
:math:`m^T x + c = 0` for each k, and the minimum is the same. Groups that turn the flange have no
slope, and take part by their points alone. As printed, eq. 18 gives the points of each group a
principal plane of their own (`own_planes`), so that groups of one board need not agree. The
source's alpha and beta are lost but for beta > alpha; lengths in the cost are in mm, as there.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array, Indices, Problem
from plumbline.optim.core.solvers import LevenbergMarquardt, Solver
from plumbline.optim.hand_eye.constants import MILLIMETRES, PARALLEL
from plumbline.optim.hand_eye.readings import (
    Beam,
    Frames,
    Plane,
    Readings,
    marks_of_planes,
    mean_beam,
    unit,
)
from plumbline.optim.hand_eye.single_plane import SinglePlane, slope

SCALES = {"r": 1e-2, "slope": 1e-1, "offset": 1e-2}  # m, 1, m


@dataclass(frozen=True)
class Weights:
    """Weights of the two terms."""

    alpha: float = 1.0  # of the normals' agreement with the slopes, a number without unit
    beta: float = 10.0  # of the squared distances from the principal planes [1/mm^2]


@dataclass(frozen=True, eq=False)
class ThreePlanes:
    """The joint problem's result."""

    beam: Beam  # the beam
    planes: tuple[Plane, ...]  # principal plane of each plane's points, in the base frame
    solution: Solution  # the solver's point, which judges itself
    start: Beam  # the beam that it started from


@dataclass(frozen=True, eq=False)
class PlaneSymbols:
    """The symbols of the problem for K planes, before any data."""

    planes: int  # number of planes K
    mains: int  # number of principal planes G: as many, or one for each group
    # directions as slopes (always of length one), rather than as three numbers under constraints
    on_spheres: bool
    x: cs.SX  # unknowns
    row: cs.SX  # a reading's or a slope's numbers
    residual: cs.SX  # of a row
    spheres: cs.SX  # squared lengths of the directions, where they are constraints

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        d, k = (2 if self.on_spheres else 3), range(1, self.planes + 1)
        g = range(1, self.mains + 1)
        axes = "xyz"
        return (
            *(f"r_{a}" for a in axes),
            *(f"v_{a}" for a in axes[:d]),
            *(f"n{i}_{a}" for i in k for a in axes[:d]),
            *(f"m{i}_{a}" for i in g for a in axes[:d]),
            *(f"c{i}" for i in g),
        )

    def scale(self) -> Array:
        """Typical sizes of the unknowns."""
        directions = (2 if self.on_spheres else 3) * (1 + self.planes + self.mains)
        sizes = [SCALES["r"]] * 3 + [SCALES["slope"]] * directions
        return np.array(sizes + [SCALES["offset"]] * self.mains)

    def start(self, beam: Beam, frames: Frames) -> Array:
        """The unknowns at a beam, normals as the planes' frames have them."""
        if self.on_spheres:
            own = np.concatenate([frames.of_beam(beam), np.zeros(2 * (self.planes + self.mains))])
        else:
            upright = np.tile([0.0, 0.0, 1.0], self.planes + self.mains)
            own = np.concatenate([frames.F.T @ beam.r, frames.F.T @ beam.v, upright])
        return np.concatenate([own, np.zeros(self.mains)])


@lru_cache(maxsize=16)
def statement(planes: int, on_spheres: bool = True, mains: int | None = None) -> PlaneSymbols:
    """The symbols for that many planes (and principal planes), written once."""
    d, G = (2 if on_spheres else 3), planes if mains is None else mains
    r, v = cs.SX.sym("r", 3), cs.SX.sym("v", d)
    n, m, c = cs.SX.sym("n", d, planes), cs.SX.sym("m", d, G), cs.SX.sym("c", G)
    row = cs.SX.sym("row", 16 + planes + G)
    R, t = cs.reshape(row[:9], 3, 3), row[9:12]
    distance, of_slope, root = row[12], row[13], row[14:16]
    chosen, group = row[16 : 16 + planes], row[16 + planes :]
    direction = unit if on_spheres else cs.SX
    beam, normal, main = direction(v), direction(n @ chosen), direction(m @ group)
    # Rows of slopes carry g in the place of t.
    agreement = root[0] * (R.T @ normal + t * cs.dot(R.T @ normal, beam))
    point = R @ (r + distance * beam) + t
    height = root[1] * (cs.dot(main, point) + cs.dot(group, c))
    residual = of_slope * agreement + (1 - of_slope) * cs.vertcat(height, 0, 0)
    every = [v, *(w[:, k] for w in (n, m) for k in range(w.size2()))]
    spheres = cs.SX(0, 1) if on_spheres else cs.vertcat(*map(cs.sumsqr, every))
    x = cs.vertcat(r, v, cs.vec(n), cs.vec(m), c)
    return PlaneSymbols(planes, G, on_spheres, x, row, residual, spheres)


def state(
    readings: Readings,
    frames: Frames,
    weights: Weights,
    *,
    on_spheres: bool = True,
    own_planes: bool = False,
) -> Problem:
    """The problem of some readings.

    ``on_spheres``: directions as slopes, for solvers without constraints; else ``|n| = |v| = 1``
    and n_z > 0 at each plane's first pose, z being the finder's, are constraints.
    """
    mains, of_main = _mains(readings, frames, own_planes)
    symbols = statement(len(frames.c), on_spheres, len(of_main))
    rows = np.concatenate([_slope_rows(readings, frames), _point_rows(readings, frames)])
    chosen = np.zeros((len(rows), len(of_main)))
    chosen[-len(readings) :] = marks_of_planes(mains, len(of_main))
    rows = np.hstack([rows, chosen])
    rows[:, 14] = np.sqrt(weights.alpha)
    rows[:, 15] = MILLIMETRES * np.sqrt(weights.beta)
    size = symbols.x.numel()
    limit = np.full(size, np.inf)
    constraints, low, high = _constraints(symbols, readings, frames)
    return Problem(
        x=symbols.x,
        names=symbols.names,
        lower=-limit,
        upper=limit,
        scale=symbols.scale(),
        residual=symbols.residual,
        row=symbols.row,
        rows=rows,
        constraints=constraints,
        g_lower=low,
        g_upper=high,
    )


def _constraints(
    symbols: PlaneSymbols, readings: Readings, frames: Frames
) -> tuple[cs.SX, Array, Array]:
    if symbols.on_spheres:
        return cs.SX(0, 1), np.empty(0), np.empty(0)
    k = symbols.planes
    n = cs.reshape(symbols.x[6 : 6 + 3 * k], 3, k)
    ahead = []
    for index, plane in enumerate(readings.planes):
        first = readings.R[readings.plane == plane][0] @ frames.F
        ahead.append(cs.dot(cs.DM(frames.B[index].T @ first[:, 2]), n[:, index]))
    unit_length = np.ones(1 + k + symbols.mains)
    low = np.concatenate([unit_length, np.zeros(k)])
    high = np.concatenate([unit_length, np.full(k, np.inf)])
    return cs.vertcat(symbols.spheres, *ahead), low, high


def _mains(readings: Readings, frames: Frames, own_planes: bool) -> tuple[Indices, Indices]:
    """Which principal plane each reading has (N,), and which frame each of those has (G,)."""
    index = frames.index(readings)
    if not own_planes:
        return index, np.arange(len(frames.c))
    pairs = np.column_stack([index, readings.motion])
    found, mains = np.unique(pairs, axis=0, return_inverse=True)
    return np.ravel(mains), np.asarray(found[:, 0], dtype=np.intp)


def _point_rows(readings: Readings, frames: Frames) -> Array:
    R, t = frames.carried(readings)
    rows = np.zeros((len(readings), 16))
    rows[:, :9] = np.swapaxes(R, 1, 2).reshape(-1, 9)  # column by column, as CasADi has it
    rows[:, 9:12], rows[:, 12] = t, readings.distance
    chosen = marks_of_planes(frames.index(readings), len(frames.c))
    return np.hstack([rows, chosen])


def _slope_rows(readings: Readings, frames: Frames) -> Array:
    found = []
    for index, plane in enumerate(readings.planes):
        for group in readings.on_plane(int(plane)).motions():
            if group.is_translation:
                found.append((index, slope(group)))
    rows = np.zeros((len(found), 16 + len(frames.c)))
    for row, (index, one) in zip(rows, found, strict=True):
        row[:9] = (frames.B[index].T @ one.R @ frames.F).T.ravel()
        row[9:12], row[13], row[16 + index] = frames.F.T @ one.g, 1.0, 1.0
    return rows


def solve_three_planes(
    readings: Readings,
    singles: list[SinglePlane],
    weights: Weights | None = None,
    solver: Solver | None = None,
    *,
    own_planes: bool = False,
) -> ThreePlanes:
    """The joint result, from the mean of the single-plane results.

    Args:
        readings: Of three planes, or of any number.
        singles: Closed forms on single planes.
        weights: alpha and beta.
        solver: Levenberg-Marquardt by default; one that takes constraints gets them.
        own_planes: A principal plane for each group, as eq. 18 is printed.

    Raises:
        PlumblineError: Two of the planes are parallel, or a group's translations are degenerate.
    """
    start = mean_beam([single.beam for single in singles])
    frames = Frames.of(readings, start)
    refuse_parallel(frames, readings)
    chosen = solver or LevenbergMarquardt()
    on_spheres = not chosen.constraints
    of_main = _mains(readings, frames, own_planes)[1]
    problem = state(
        readings, frames, weights or Weights(), on_spheres=on_spheres, own_planes=own_planes
    )
    symbols = statement(len(frames.c), on_spheres, len(of_main))
    solution = chosen.solve(problem, symbols.start(start, frames))
    return ThreePlanes(*_read(solution.x, frames, on_spheres, of_main), solution, start)


def _read(
    x: Array, frames: Frames, on_spheres: bool, of_main: Indices
) -> tuple[Beam, tuple[Plane, ...]]:
    d, k, g = (2 if on_spheres else 3), len(frames.c), len(of_main)
    v = np.append(x[3:5], 1.0) if on_spheres else x[3:6]
    beam = Beam.of(frames.F @ x[:3], frames.F @ v)
    main = x[3 + d + d * k : 3 + d + d * (k + g)].reshape(g, d)
    slopes = main if on_spheres else main[:, :2] / main[:, 2:]
    planes = tuple(frames.plane(int(k), slopes[i], x[i - g]) for i, k in enumerate(of_main))
    return beam, planes


def refuse_parallel(frames: Frames, readings: Readings) -> None:
    """Refuse planes of which two are parallel."""
    for i, j, angle in parallel_planes(frames):
        raise PlumblineError(
            f"planes {readings.planes[i]} and {readings.planes[j]} are parallel within "
            f"{np.rad2deg(angle):.1f} deg, {np.rad2deg(PARALLEL):.0f} deg or more expected; turn "
            "one of the boards"
        )


def parallel_planes(frames: Frames) -> list[tuple[int, int, float]]:
    """Pairs of frames whose planes are parallel, from 0, and the angle between them [rad]."""
    normals = frames.B[:, :, 2]
    found = []
    for i in range(len(normals)):
        for j in range(i + 1, len(normals)):
            sine = float(np.linalg.norm(np.cross(normals[i], normals[j])))
            if sine < np.sin(PARALLEL):
                found.append((i, j, float(np.arcsin(sine))))
    return found

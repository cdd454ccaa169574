r"""The joint problem on several planes with the coplanarity penalty (Zeng et al. 2017, eqs. 16-18).

.. math:: \min\ \sum_k \sum_{groups} \alpha\, |n + g\,p|^2 + \beta \sum |X - X_{fit}|^2, \qquad
          p = n^T v,\ |n| = |v| = 1,\ n_z > 0

g is the slope of a group of pure translations (:mod:`plumbline.optim.hand_eye.single_plane`), X are
all rebuilt points of plane k and X_fit their projections on their own principal plane. That plane
is the one that minimises the distances, so it becomes an unknown beside the others: a plane
:math:`m^T x + c = 0` for each k, and the minimum is the same. Groups that turn the flange have no
slope, and take part by their points alone. As printed, eq. 18 gives the points of each group a
principal plane of their own (`own_planes`), so that groups of one board need not agree. Directions
are slopes in frames of the planes, of length one and looking ahead. The source's alpha and beta are
lost but for beta > alpha; lengths in the cost are in mm, as there.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array, Indices, Problem
from plumbline.optim.core.solvers import LevenbergMarquardt, Solver
from plumbline.optim.hand_eye.constants import MILLIMETRES, PARALLEL
from plumbline.optim.hand_eye.direct import start as first
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


@lru_cache(maxsize=16)
def statement(planes: int, mains: int | None = None) -> Problem:
    """The problem of that many planes and as many principal ones or others, before any data.

    A row is a reading's or a slope's numbers.
    """
    G = planes if mains is None else mains
    r, v = cs.SX.sym("r", 3), cs.SX.sym("v", 2)
    n, m, c = cs.SX.sym("n", 2, planes), cs.SX.sym("m", 2, G), cs.SX.sym("c", G)
    row = cs.SX.sym("row", 16 + planes + G)
    R, t = cs.reshape(row[:9], 3, 3), row[9:12]
    distance, of_slope, root = row[12], row[13], row[14:16]
    chosen, group = row[16 : 16 + planes], row[16 + planes :]
    beam, normal, main = unit(v), unit(n @ chosen), unit(m @ group)
    # Rows of slopes carry g in the place of t.
    agreement = root[0] * (R.T @ normal + t * cs.dot(R.T @ normal, beam))
    point = R @ (r + distance * beam) + t
    height = root[1] * (cs.dot(main, point) + cs.dot(group, c))
    residual = of_slope * agreement + (1 - of_slope) * cs.vertcat(height, 0, 0)
    x = cs.vertcat(r, v, cs.vec(n), cs.vec(m), c)
    k, g = range(1, planes + 1), range(1, G + 1)
    ways = ("v", *(f"n{i}" for i in k), *(f"m{i}" for i in g))
    slopes = (f"{way}_{a}" for way in ways for a in "xy")
    names = ("r_x", "r_y", "r_z", *slopes, *(f"c{i}" for i in g))
    scale = np.repeat(list(SCALES.values()), (3, 2 * (1 + planes + G), G))
    limit = np.full(x.numel(), np.inf)
    return Problem(x, names, -limit, limit, scale, residual=residual, row=row)


def state(
    readings: Readings, frames: Frames, weights: Weights, *, own_planes: bool = False
) -> Problem:
    """The problem of some readings; directions are slopes, so that their length is one."""
    mains, of_main = _mains(readings, frames, own_planes)
    rows = np.concatenate([_slope_rows(readings, frames), _point_rows(readings, frames)])
    chosen = np.zeros((len(rows), len(of_main)))
    chosen[-len(readings) :] = marks_of_planes(mains, len(of_main))
    rows = np.hstack([rows, chosen])
    rows[:, 14] = np.sqrt(weights.alpha)
    rows[:, 15] = MILLIMETRES * np.sqrt(weights.beta)
    return statement(len(frames.c), len(of_main)).on(rows)


def _mains(readings: Readings, frames: Frames, own_planes: bool) -> tuple[Indices, Indices]:
    """Which principal plane each reading has (N,), and which frame each of those has (G,)."""
    index = frames.index(readings)
    if not own_planes:
        return index, np.arange(len(frames.c))
    pairs = np.column_stack([index, readings.motion])
    found, mains = np.unique(pairs, axis=0, return_inverse=True)
    return np.ravel(mains), np.asarray(found[:, 0], dtype=np.intp)


def _point_rows(readings: Readings, frames: Frames) -> Array:
    chosen = marks_of_planes(frames.index(readings), len(frames.c))
    return np.hstack([frames.carried(readings).rows, np.zeros((len(readings), 3)), chosen])


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
        solver: Levenberg-Marquardt by default.
        own_planes: A principal plane for each group, as eq. 18 is printed.

    Raises:
        PlumblineError: Two of the planes are parallel, or a group's translations are degenerate.
    """
    start = mean_beam([single.beam for single in singles])
    frames = Frames.of(readings, start)
    refuse_parallel(frames, readings)
    of_main = _mains(readings, frames, own_planes)[1]
    problem = state(readings, frames, weights or Weights(), own_planes=own_planes)
    solution = (solver or LevenbergMarquardt()).solve(problem, first(problem, start, frames))
    return ThreePlanes(*_read(solution.x, frames, of_main), solution, start)


def _read(x: Array, frames: Frames, of_main: Indices) -> tuple[Beam, tuple[Plane, ...]]:
    g, first = len(of_main), 5 + 2 * len(frames.c)
    slopes = x[first : first + 2 * g].reshape(g, 2)
    planes = (frames.plane(int(k), slopes[i], x[i - g]) for i, k in enumerate(of_main))
    return frames.beam(x), tuple(planes)


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
    for i, j in combinations(range(len(normals)), 2):
        sine = float(np.linalg.norm(np.cross(normals[i], normals[j])))
        if sine < np.sin(PARALLEL):
            found.append((i, j, float(np.arcsin(sine))))
    return found

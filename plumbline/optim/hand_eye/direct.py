r"""The direct statement: every reading an equation of its own (Zeng et al. 2017, eq. 5).

.. math:: e_j = n_k^T \big(R_j (r + \tilde d_j v) + t_j\big) + b_k - h_k(j) - a(j), \qquad
          \tilde d_j = d_j - \kappa \Big(\frac{1}{\cos\theta_j} - 1\Big), \quad
          \cos\theta_j = n_k^T R_j v

          \min \sum_j \frac{e_j^2}{\sigma_j^2} + \sum_{k, m} \frac{c_{km}^2}{s^2}
          + \sum_m \frac{g_m^2}{s_a^2} + \frac{\kappa^2}{s_\kappa^2}

No pose is a reference, no group is special, planes are free of each other and any number will do.
h is how far the board stands out of its plane where the reading lies, a the arm's error there: sums
of smooth shapes, c phi and g psi (:mod:`.shapes`), that shrink to zero where the readings do not
ask for them. kappa is the bias of slanted beams: it moves the equations as r along the beam does,
so that only a prior tells the two apart. The variances are those of :mod:`.reweighting`.
"""

from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.optim.core.problem import Array, Indices, Integers, Problem
from plumbline.optim.hand_eye.constants import ARM, BIAS, BOW, FIXED, SIZES
from plumbline.optim.hand_eye.readings import Beam, Frames, Plane, Readings, marks_of_planes, unit


@lru_cache(maxsize=16)
def statement(planes: int, shapes: int, arm: int = 0, biased: bool = False) -> Problem:
    """The statement for K planes of M shapes each and A shapes of the arm, before any data.

    Unknowns are r, the slopes of v and of the normals, offsets, shapes, the bias of slanted beams
    where they may have one, and the arm's shapes. A row is R' (9), t' (3), d, 1 for a reading,
    planes (K), shapes (M), 1 for the bias's prior, arm's shapes (A); its residual is the distance
    from the board [m], or the coefficient for a row of the prior.
    """
    r, v = cs.SX.sym("r", 3), cs.SX.sym("v", 2)
    n, b = cs.SX.sym("n", 2, planes), cs.SX.sym("b", planes)
    c = cs.SX.sym("c", shapes, planes)
    kappa, g = cs.SX.sym("kappa", int(biased)), cs.SX.sym("g", arm)
    row = cs.SX.sym("row", FIXED + planes + shapes + int(biased) + arm)
    R, t = cs.reshape(row[:9], 3, 3), row[9:12]
    distance, real = row[12], row[13]
    chosen, phi = row[FIXED : FIXED + planes], row[FIXED + planes : FIXED + planes + shapes]
    rest = row[FIXED + planes + shapes :]
    normal, beam = unit(n @ chosen), unit(v)
    height = cs.dot(normal, R @ (r + distance * beam) + t) + cs.dot(chosen, b)
    if biased:
        height -= kappa * (1 - cs.dot(normal, R @ beam))
    smooth = cs.dot(phi, c @ chosen) if shapes else 0
    smooth += cs.dot(rest, cs.vertcat(kappa, g)) if biased or arm else 0
    x = cs.vertcat(r, v, cs.vec(n), b, cs.vec(c), kappa, g)
    counts = (3, 2, 2 * planes, planes, planes * shapes, int(biased), arm)
    limit = np.full(x.numel(), np.inf)
    return Problem(
        x, _names(planes, shapes, arm, biased), -limit, limit, np.repeat(SIZES, counts),
        residual=real * height - smooth, row=row,
    )  # fmt: skip


def _names(planes: int, shapes: int, arm: int, biased: bool) -> tuple[str, ...]:
    k, m = range(1, planes + 1), range(1, shapes + 1)
    normals = (f"n{i}_{a}" for i in k for a in "xy")
    of_boards = (f"h{i}_{j}" for i in k for j in m)
    beam, of_arm = ("r_x", "r_y", "r_z", "v_x", "v_y"), (f"g{j + 1}" for j in range(arm))
    return (*beam, *normals, *(f"b{i}" for i in k), *of_boards, *("kappa",) * biased, *of_arm)


def state(
    readings: Readings,
    frames: Frames,
    shapes: Array | None = None,
    arm: Array | None = None,
    *,
    biased: bool = False,
) -> Problem:
    """The problem of N readings, all weights 1, the prior's rows last.

    ``shapes`` (N, M) are of the boards, ``arm`` (N, A) of the arm; none by default.
    """
    none = np.empty((len(readings), 0))
    phi, psi = (none if given is None else given for given in (shapes, arm))
    count = len(frames.c)
    s = statement(count, phi.shape[1], psi.shape[1], biased)
    rows = np.hstack(
        [
            frames.carried(readings).rows,
            np.ones((len(readings), 1)),
            marks_of_planes(frames.index(readings), count),
            phi,
            np.zeros((len(readings), int(biased))),
            psi,
        ]
    )
    return s.on(np.concatenate([rows, _prior_rows(s, count, phi.shape[1])]))


def _prior_rows(s: Problem, planes: int, shapes: int) -> Array:
    """One row for each coefficient, in the order of :func:`prior_kinds`, to be pulled to zero."""
    of_boards = planes * shapes
    others = s.size - 5 - 3 * planes - of_boards
    rows = np.zeros((of_boards + others, s.row.numel()))
    at = np.arange(of_boards)
    if of_boards:
        rows[at, FIXED + at // shapes] = 1.0
        rows[at, FIXED + planes + at % shapes] = 1.0
    rest = np.arange(others)
    rows[of_boards + rest, FIXED + planes + shapes + rest] = 1.0
    return rows


def prior_kinds(problem: Problem) -> Integers:
    """Which kind each row of the prior is, by the unknown that it pulls: BOW, ARM or BIAS."""
    kinds = {"h": BOW, "k": BIAS, "g": ARM}
    return np.array([kinds[name[0]] for name in problem.names if name[0] in kinds], dtype=np.int64)


def heights(problem: Problem, x: Array, frames: Frames, index: Indices) -> Array:
    """How far each reading's board stands out there (N,) [m]; `index` is its plane from 0 (N,)."""
    planes = len(frames.c)
    shapes = sum(name.startswith("h1_") for name in problem.names)
    phi = problem.rows[: len(index), FIXED + planes : FIXED + planes + shapes]
    own = x[5 + 3 * planes :][: planes * shapes].reshape(planes, shapes)[index]
    return np.asarray(np.sum(phi * own, axis=1))


def start(problem: Problem, beam: Beam, frames: Frames) -> Array:
    """The unknowns (P,) of a problem at a beam whose planes are the frames."""
    return np.concatenate([frames.of_beam(beam), np.zeros(problem.size - 5)])


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

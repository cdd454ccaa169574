r"""Flange poses that send the beam to a point, within an angle of the face's normal.

Seen from the flange the face's inward normal is u = R^T n_in; u within a cone about the beam v
keeps the beam within that angle of the normal. For each u there is one circle of poses, turned by
psi about the normal:

.. math:: R = R_{n_{in}}(\psi)\, R_{u \to n_{in}}, \qquad t = p - R\,(r + s\, v)

with s the stand-off. Many (u, psi, s) are tried at once; the first that the arm reaches is taken.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Arm, Array, placed, rotations
from plumbline.experiments.reality.ranging.wrist import BRANCHES, inverse

TRIES = 6  # poses tried at once for each point
STRAIGHT = 0.15  # rad: a wrist as straight as this is avoided, its axes would align


@dataclass(frozen=True)
class Cone:
    """How beams may meet a face."""

    tilt: float = np.deg2rad(30.0)  # largest angle from the face's normal [rad]
    nearest: float = 0.22  # least stand-off [m]
    farthest: float = 0.45  # largest stand-off [m]
    least_tilt: float = 0.0  # least angle from the face's normal [rad]


def about(axes: Array, angles: Array) -> Array:
    """Rotation matrices (N, 3, 3) about unit axes (N, 3) by angles (N,) [rad]."""
    return rotations(axes * angles[:, None])


def taking(a: Array, b: Array) -> Array:
    """The shortest rotations (N, 3, 3) that take unit vectors a (N, 3) to b (N, 3)."""
    normal = np.cross(a, b)
    sine = np.linalg.norm(normal, axis=1)
    angle = np.arctan2(sine, np.sum(a * b, axis=1))
    spare = np.cross(a, np.eye(3)[np.argmin(np.abs(a), axis=1)])  # for b = -a
    axis = np.where(sine[:, None] > 1e-9, normal, spare)
    return about(axis / np.linalg.norm(axis, axis=1, keepdims=True), angle)


def tilted(v: Array, tilt: Array, azimuth: Array) -> Array:
    """Unit vectors (N, 3) at angles (N,) from v (3,), turned by azimuths (N,) about it [rad]."""
    first = np.cross(v, np.eye(3)[int(np.argmin(np.abs(v)))])
    first /= np.linalg.norm(first)
    second = np.cross(v, first)
    lateral = np.cos(azimuth)[:, None] * first + np.sin(azimuth)[:, None] * second
    return np.asarray(np.cos(tilt)[:, None] * v + np.sin(tilt)[:, None] * lateral)


def flanges(
    r: Array, v: Array, points: Array, inward: Array, seen: Array, turn: Array, stand: Array
) -> Array:
    """Flange poses (N, 4, 4) that send the beam from r [m] along v to points (N, 3) [m].

    Into faces with unit normals ``inward`` (N, 3), which the flange sees as ``seen`` (N, 3), turned
    about them by (N,) [rad], with beams (N,) [m] long.
    """
    R = about(inward, turn) @ taking(seen, inward)
    return placed(R, points - np.einsum("nij,nj->ni", R, r + stand[:, None] * v))


def each_reached(
    arm: Arm,
    beam: tuple[Array, Array],
    points: Array,
    inward: Array,
    cone: Cone,
    rng: np.random.Generator,
    rounds: int = 25,
) -> tuple[Array, NDArray[np.bool_]]:
    """A random posture (N, n) [rad] for each point (N, 3) [m], and which points were reached (N,).

    Beams, from (3,) [m] along (3,) in the flange frame, have any tilt, turn and stand-off within
    the cone about unit normals (N, 3) into the faces; `TRIES` poses a round for each point not
    reached so far.
    """
    q, reached = np.zeros((len(points), arm.joints)), np.zeros(len(points), dtype=bool)
    for _ in range(rounds):
        open_ = np.flatnonzero(~reached)
        if not len(open_):
            break
        found, good = _tried(arm, beam, points[open_], inward[open_], cone, rng)
        q[open_[good]] = found[good]
        reached[open_[good]] = True
    return q, reached


def _tried(
    arm: Arm,
    beam: tuple[Array, Array],
    points: Array,
    inward: Array,
    cone: Cone,
    rng: np.random.Generator,
) -> tuple[Array, NDArray[np.bool_]]:
    """One round of poses for every point."""
    total = len(points) * TRIES
    # Even over the cone's solid angle.
    cosines = rng.uniform(np.cos(cone.tilt), np.cos(cone.least_tilt), total)
    seen = tilted(beam[1], np.arccos(cosines), rng.uniform(0.0, 2 * np.pi, total))
    turn = rng.uniform(-np.pi, np.pi, total)
    stand = rng.uniform(cone.nearest, cone.farthest, total)
    aims, ways = np.repeat(points, TRIES, axis=0), np.repeat(inward, TRIES, axis=0)
    q, good = _bent(arm, flanges(*beam, aims, ways, seen, turn, stand))
    good = good.reshape(len(points), -1)
    first = np.argmax(good, axis=1)
    chosen = q.reshape(len(points), TRIES * BRANCHES, -1)[np.arange(len(points)), first]
    return chosen, np.asarray(good.any(axis=1), dtype=bool)


def together(
    arm: Arm,
    beam: tuple[Array, Array],
    points: Array,
    inward: Array,
    seen: Array,
    stand: Array,
    rng: np.random.Generator,
    turns: int = 12,
) -> Array | None:
    """Postures (N, n) for all points at ONE orientation of the flange: a pure translation.

    As `each_reached`, but for one face with the unit normal ``inward`` (3,), seen by the flange as
    ``seen`` (3,), and beams (N,) [m] long. All on one branch; None if no turn about the normal will
    do.
    """
    count = len(points)
    angles = rng.uniform(0.0, 2 * np.pi) + 2 * np.pi * rng.permutation(turns) / turns
    poses = flanges(
        *beam,
        np.tile(points, (turns, 1)),
        np.tile(inward, (turns * count, 1)),
        np.tile(seen, (turns * count, 1)),
        np.repeat(angles, count),
        np.tile(stand, turns),
    )
    q, good = _bent(arm, poses)
    whole = good.reshape(turns, count, BRANCHES).all(axis=1)
    if not whole.any():
        return None
    turn, branch = np.argwhere(whole)[0]
    return np.asarray(q.reshape(turns, count, BRANCHES, -1)[turn, :, branch])


def _bent(arm: Arm, poses: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Postures (N, 8, n) of poses, and which are in reach with the wrist bent (N, 8)."""
    q, good = inverse(arm, poses)
    return q, good & (np.abs(q[:, :, 4]) > STRAIGHT)

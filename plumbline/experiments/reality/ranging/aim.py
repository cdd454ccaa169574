r"""Flange poses that send the beam to a point, within an angle of the face's normal.

Seen from the flange the face's inward normal is u = R^T n_in; u within a cone about the beam v
keeps the beam within that angle of the normal. For each u there is one circle of poses, turned by
psi about the normal:

.. math:: R = R_{n_{in}}(\psi)\, R_{u \to n_{in}}, \qquad t = p - R\,(r + s\, v)

with s the stand-off. Many (u, psi, s) are tried at once; the first that the arm reaches is taken.

Its postures, of an arm of the VS060's build, are known in closed form. The last three axes meet in
the wrist's centre, d_6 behind the flange:

    W = p - d_6 z,   rho = +-hypot(W_x, W_y),   h = d_1 - W_z

The upper arm (a_2) and the forearm (a_3, d_4) form a triangle over (rho, h), which the law of
cosines solves, elbow up or down; what remains of the orientation is z-y-z,

    R_36 = Rz(q_4) Ry(q_5) Rz(q_6).

Two shoulders, two elbows and two wrists make eight postures.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Arm, Array, placed, rotations

TRIES = 6  # poses tried at once for each point
TURNS = 12  # about a face's normal that are tried for all points at once
STRAIGHT = 0.15  # rad: a wrist as straight as this is avoided, its axes would align
BRANCHES = 8  # postures of one flange pose


@dataclass(frozen=True)
class Cone:
    """How beams may meet a face."""

    tilt: float = np.deg2rad(30.0)  # largest angle from the face's normal [rad]
    nearest: float = 0.22  # least stand-off [m]
    farthest: float = 0.45  # largest stand-off [m]


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
    cosines = rng.uniform(np.cos(cone.tilt), 1.0, total)
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
) -> Array | None:
    """Postures (N, n) for all points at ONE orientation of the flange: a pure translation.

    As `each_reached`, but for one face with the unit normal ``inward`` (3,), seen by the flange as
    ``seen`` (3,), and beams (N,) [m] long. All on one branch; None if no turn about the normal will
    do.
    """
    count = len(points)
    angles = rng.uniform(0.0, 2 * np.pi) + 2 * np.pi * rng.permutation(TURNS) / TURNS
    poses = flanges(
        *beam,
        np.tile(points, (TURNS, 1)),
        np.tile(inward, (TURNS * count, 1)),
        np.tile(seen, (TURNS * count, 1)),
        np.repeat(angles, count),
        np.tile(stand, TURNS),
    )
    q, good = _bent(arm, poses)
    whole = good.reshape(TURNS, count, BRANCHES).all(axis=1)
    if not whole.any():
        return None
    turn, branch = np.argwhere(whole)[0]
    return np.asarray(q.reshape(TURNS, count, BRANCHES, -1)[turn, :, branch])


def _bent(arm: Arm, poses: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Postures (N, 8, n) of poses, and which are in reach with the wrist bent (N, 8)."""
    q, good = inverse(arm, poses)
    return q, good & (np.abs(q[:, :, 4]) > STRAIGHT)


def inverse(arm: Arm, poses: Array) -> tuple[Array, NDArray[np.bool_]]:
    """All postures (N, 8, 6) [rad] of flange poses (N, 4, 4) in the base frame [m].

    And which of them exist within the joint ranges (N, 8), of an arm of the VS060's build.
    """
    centre = poses[:, :3, 3] - arm.d[5] * poses[:, :3, 2]
    q = np.zeros((len(poses), BRANCHES, 6))
    there = np.zeros((len(poses), BRANCHES), dtype=bool)
    for shoulder in (0, 1):
        for elbow in (0, 1):
            first, found = _first_three(arm, centre, shoulder, elbow)
            rest = _behind_elbow(arm, first, poses[:, :3, :3])
            for wrist in (0, 1):
                k = 4 * shoulder + 2 * elbow + wrist
                q[:, k, :3], q[:, k, 3:] = first, _last_three(rest, wrist)
                there[:, k] = found
    q = np.asarray((q + np.pi) % (2.0 * np.pi) - np.pi)
    inside = np.all((q >= arm.lower) & (q <= arm.upper), axis=2)
    return q, there & inside


def _first_three(
    arm: Arm, centre: Array, shoulder: int, elbow: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Turn, shoulder and elbow (N, 3) that bring the wrist's centre (N, 3) into place."""
    side, bend = 1.0 - 2.0 * shoulder, 1.0 - 2.0 * elbow
    turn = np.arctan2(side * centre[:, 1], side * centre[:, 0])
    rho, drop = side * np.hypot(centre[:, 0], centre[:, 1]), arm.d[0] - centre[:, 2]
    upper, fore = arm.a[1], np.hypot(arm.a[2], arm.d[3])
    span = np.hypot(rho, drop)
    cosine = (span**2 - upper**2 - fore**2) / (2.0 * upper * fore)
    knee = bend * np.arccos(np.clip(cosine, -1.0, 1.0))
    lift = np.arctan2(drop, rho) - np.arctan2(fore * np.sin(knee), upper + fore * np.cos(knee))
    # The forearm's line lies this far ahead of the elbow's x axis.
    lead = np.arctan2(-arm.d[3], arm.a[2])
    first = np.stack([turn, lift - arm.theta[1], knee - lead - arm.theta[2]], axis=1)
    return first, np.abs(cosine) < 1.0 - 1e-4


def _behind_elbow(arm: Arm, first: Array, turn: Array) -> Array:
    """What the wrist must turn by (N, 3, 3): R_03^T R, with R_03 = Rz(q_1) Ry(q_2 + q_3 + ...)."""
    lift = first[:, 1] + first[:, 2] + arm.theta[1] + arm.theta[2]
    c, s = np.cos(first[:, 0])[:, None], np.sin(first[:, 0])[:, None]
    x, y = turn[:, 0], turn[:, 1]
    ahead, aside, up = c * x + s * y, c * y - s * x, turn[:, 2]
    c, s = np.cos(lift)[:, None], np.sin(lift)[:, None]
    return np.stack([c * ahead - s * up, aside, s * ahead + c * up], axis=1)


def _last_three(rest: Array, wrist: int) -> Array:
    """Wrist angles (N, 3) for the wrist's own rotations (N, 3, 3)."""
    sign = 1.0 - 2.0 * wrist
    bend = sign * np.arccos(np.clip(rest[:, 2, 2], -1.0, 1.0))
    roll = np.arctan2(sign * rest[:, 1, 2], sign * rest[:, 0, 2])
    spin = np.arctan2(sign * rest[:, 2, 1], -sign * rest[:, 2, 0])
    return np.stack([roll, bend, spin], axis=1)

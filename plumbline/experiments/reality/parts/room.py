r"""A range finder on an arm among three boards, and what it reads there.

.. math:: d = \min \{ s > 0 : o + s\,w \in \text{board} \}, \qquad o = R\,r + t,\ w = R\,v

Boards may carry a spherical cap of height h and foot radius c about a point of their face, whose
sphere of radius :math:`(c^2 + h^2) / 2h` is met by the beam exactly; h may be negative.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Arm, Array, forward, rotations

HALF = 0.45  # half side of a board [m]
NEAREST, FARTHEST = 0.15, 1.1  # ranges that the finder reads [m]
STEEPEST = np.deg2rad(62.0)  # largest angle from a board's normal that it reads [rad]
PACE = 6.0  # from row to row [s]


@dataclass(frozen=True, eq=False)
class Cap:
    """A bulge: where on the face (2,) [m], its foot's radius [m], its height [m]."""

    middle: Array
    foot: float
    height: float


@dataclass(frozen=True, eq=False)
class Room:
    """An arm, the beam on its flange, and the boards: middles (K, 3) [m], axes (K, 3, 3)."""

    arm: Arm
    r: Array
    v: Array
    middles: Array
    axes: Array


def draw_room(arm: Arm, rng: np.random.Generator) -> Room:
    """A floor and two walls within reach, roughly square to each other, the finder anyhow."""
    v = np.array([0.0, 0.0, 1.0]) + 0.2 * rng.normal(size=3)
    faces = [np.eye(3), np.eye(3)[:, [1, 2, 0]], np.eye(3)[:, [2, 0, 1]]]
    axes = np.stack([rotations(0.15 * rng.normal(size=3)) @ face for face in faces])
    places = np.array([[0.55, 0.0, -0.15], [1.05, 0.05, 0.45], [0.5, 0.85, 0.45]])
    # Columns of an axes' matrix are x, y and the normal: up, along x, along y; towards the arm.
    signs = np.array([1.0, -1.0, -1.0])
    axes = axes.copy()
    axes[:, :, 2] *= signs[:, None]
    axes[:, :, 1] *= signs[:, None]
    middles = places + 0.05 * rng.normal(size=(3, 3))
    r = np.array([0.03, -0.02, 0.08]) + 0.02 * rng.normal(size=3)
    return Room(arm, r, v / np.linalg.norm(v), middles, axes)


def rays(room: Room, flange: Array) -> tuple[Array, Array]:
    """Starts (N, 3) [m] and directions (N, 3) of the beams at flange poses (N, 4, 4)."""
    return flange[:, :3, :3] @ room.r + flange[:, :3, 3], flange[:, :3, :3] @ room.v


def meet(
    room: Room, start: Array, way: Array, board: NDArray[np.int64], cap: Cap | None = None
) -> tuple[Array, Array, Array]:
    """Ranges (N,) [m] to boards (N,) from 0, slopes (N, 2) of the face, and places (N, 2) [m].

    Of beams that start at (N, 3) [m] and point along (N, 3), on faces with a bulge if one is given.
    """
    A = room.axes[board]
    o = np.einsum("nji,nj->ni", A, start - room.middles[board])
    w = np.einsum("nji,nj->ni", A, way)
    s = -o[:, 2] / w[:, 2]
    if cap is not None and cap.height:
        s = np.where(np.isfinite(t := _sphere(o, w, cap)), t, s)
    return s, w[:, :2] / w[:, 2:], (o + s[:, None] * w)[:, :2]


def _sphere(o: Array, w: Array, cap: Cap) -> Array:
    """Range to the cap's sphere (N,) [m], not a number where the beam passes beside its foot."""
    h, c = cap.height, cap.foot
    radius = (c * c + h * h) / (2.0 * abs(h))
    centre = np.array([*cap.middle, np.sign(h) * (abs(h) - radius)])
    to = o - centre
    b, square = np.sum(to * w, axis=1), np.sum(to * to, axis=1)
    root = np.sqrt(np.maximum(b * b - square + radius**2, 0.0))
    s = -b - np.sign(h) * root  # from outside the near side, into a hollow the far one
    foot = np.linalg.norm((o + s[:, None] * w)[:, :2] - cap.middle, axis=1)
    return np.where(foot < c, s, np.nan)


def plan(room: Room, rows: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.int64]]:
    """Postures (rows, n) whose beams meet boards, as many on each, and the boards from 0.

    Raises:
        PlumblineError: The arm reaches too few.
    """
    q = rng.uniform(room.arm.lower, room.arm.upper, (60 * rows, room.arm.joints))
    start, way = rays(room, forward(room.arm, q)[:, -1])
    found_q, found_board = [], []
    for k in range(len(room.middles)):
        board = np.full(len(q), k)
        s, slope, place = meet(room, start, way, board)
        towards = np.einsum("nj,j->n", way, room.axes[k, :, 2]) < 0.0
        good = towards & (s > NEAREST) & (s < FARTHEST) & (np.abs(place) < HALF).all(axis=1)
        good &= np.linalg.norm(slope, axis=1) < np.tan(STEEPEST)
        mine = np.flatnonzero(good)[: rows // len(room.middles)]
        if len(mine) < 12:
            raise PlumblineError(f"board {k + 1} is met by {len(mine)} beams, at least 12 needed")
        found_q.append(q[mine])
        found_board.append(board[mine])
    order = rng.permutation(sum(map(len, found_q)))
    return np.concatenate(found_q)[order], np.concatenate(found_board)[order].astype(np.int64)

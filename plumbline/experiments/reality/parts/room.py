r"""A range finder on an arm among three boards, and what it reads there.

.. math:: d = \min \{ s > 0 : o + s\,w \in \text{board} \}, \qquad o = R\,r + t,\ w = R\,v

Boards may carry a spherical cap of height h and foot radius c about a point of their face, whose
sphere of radius :math:`(c^2 + h^2) / 2h` is met by the beam exactly; h may be negative.

What is wrong has forms of its own. A slanted spot is read by its light: a Gaussian spot of rays,
each returning the less the farther it went, is averaged ray by ray; the spot widens with the range.
A finder's clock runs fast; joints stand off, turn unevenly or twist under load; a base is bumped.
Of what no library lists: a phase finder's cyclic error, a cold finder that warms up, a board that
comes to lean, stripes of paint, a tilt that tells left from right by its cube.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Arm, Array, forward, load_torque, placed, rotations
from plumbline.experiments.reality.chances import unit
from plumbline.experiments.reality.ranges import Ranges

RANGES = Ranges("part")
HALF = 0.45  # half side of a board [m]
NEAREST, FARTHEST = 0.15, 1.1  # ranges that the finder reads [m]
STEEPEST = np.deg2rad(62.0)  # largest angle from a board's normal that it reads [rad]
PACE = 6.0  # from row to row [s]
BEHIND = 0.3  # where the light comes from [m behind the face]
NEAR = 0.1  # share of the light at which an edge is seen
GRID = np.linspace(-2.5, 2.5, 61)  # rays across a spot [its standard deviations]
OF_ARM = ("joint_offset", "transmission_ripple", "joint_compliance")
OF_ROOM = ("range_scale", "incidence_bias", "plane_unflatness", "base_bump")
BEYOND = ("cyclic", "leaning_board", "stripes", "cubed_tilt")


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
    v = np.array([0.0, 0.0, 1.0]) + RANGES.near("beam", rng, 3)
    faces = [np.eye(3), np.eye(3)[:, [1, 2, 0]], np.eye(3)[:, [2, 0, 1]]]
    axes = np.stack([rotations(RANGES.near("square", rng, 3)) @ face for face in faces])
    places = np.array([[0.55, 0.0, -0.15], [1.05, 0.05, 0.45], [0.5, 0.85, 0.45]])
    # Columns of an axes' matrix are x, y and the normal: up, along x, along y; towards the arm.
    signs = np.array([1.0, -1.0, -1.0])
    axes = axes.copy()
    axes[:, :, 2] *= signs[:, None]
    axes[:, :, 1] *= signs[:, None]
    middles = places + RANGES.near("place", rng, (3, 3))
    r = np.array([0.03, -0.02, 0.08]) + RANGES.near("mount", rng, 3)
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
    """Postures (rows, n) whose beams meet boards, as many on each, and the boards from 0."""
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


@dataclass(frozen=True, eq=False)
class Flaw:
    """One thing wrong: its name, where, and what was drawn of its form; its size comes apart."""

    name: str
    element: int | None = None
    form: Mapping[str, Array] = field(default_factory=dict)


def draw_flaw(name: str, room: Room, rows: int, rng: np.random.Generator) -> Flaw:
    """A flaw of that name."""
    n, boards = room.arm.joints, len(room.middles)
    form = {
        "phase": rng.uniform(0.0, 2 * np.pi, 1),
        "way": np.array(unit(rng)),
        "turn": np.array(unit(rng)),
        "moment": RANGES.many("moment", rng, 1) * rows * PACE,
        "foot": RANGES.many("foot", rng, 1),
        "middle": RANGES.many("middle", rng, 2),
        "edge": rng.integers(0, 2, 1).astype(float),
        "period": RANGES.many("period", rng, 1),
    }
    element = None
    if name in OF_ARM:
        last = 5 if name == "joint_compliance" else n  # a wrist holds nothing that twists it
        element = int(rng.integers(2, last))  # not the first or last: planes and beam hide those
    if name in ("plane_unflatness", "leaning_board", "stripes"):
        element = int(rng.integers(1, boards + 1))
    return Flaw(name, element, form)


def ranges(
    room: Room, q: Array, board: NDArray[np.int64], flaw: Flaw | None = None, size: float = 0.0
) -> Array:
    """Ranges (N,) [m] to boards (N,) from 0 at joint readings q (N, n) [rad or m].

    With a flaw, if any, of that size in its own unit: m, rad, or a share.
    """
    time: Array = PACE * np.arange(len(q), dtype=float)
    if flaw is None:
        return meet(room, *rays(room, forward(room.arm, q)[:, -1]), board)[0]
    flange = forward(room.arm, q + _joints(room, q, flaw, size))[:, -1]
    if flaw.name == "base_bump":
        flange = _bumped(flange, flaw, size, time)
    start, way = rays(room, flange)
    cap = None
    mine = board + 1 == flaw.element
    if flaw.name == "plane_unflatness":
        cap = Cap(flaw.form["middle"], float(flaw.form["foot"][0]), size)
    s, slope, place = meet(room, start, way, board)
    if cap is not None:
        s = np.where(mine, meet(room, start, way, board, cap)[0], s)
    error = ERRORS.get(flaw.name)
    if error is None:
        return s
    turned = np.einsum("nji,nj->ni", flange[:, :3, :3], room.axes[board][:, :, 2])
    return np.asarray(s + size * error(s, slope, place, time, mine, turned, flaw))


def _joints(room: Room, q: Array, flaw: Flaw, size: float) -> Array:
    off = np.zeros_like(q)
    j = (flaw.element or 1) - 1
    if flaw.name == "joint_offset":
        off[:, j] = size
    if flaw.name == "transmission_ripple":
        off[:, j] = size * np.cos(q[:, j] - flaw.form["phase"])
    if flaw.name == "joint_compliance":
        frames = forward(room.arm, q)
        torque = load_torque(room.arm, frames)[:, j]
        torque = torque / max(float(np.abs(torque).max()), 1e-9)
        off[:, j] = size * torque / (1.0 + 0.2 * np.abs(torque))  # it stiffens
    return off


def _bumped(flange: Array, flaw: Flaw, size: float, time: Array) -> Array:
    moved = placed(rotations(size * flaw.form["turn"]), size * flaw.form["way"])
    return np.where((time > flaw.form["moment"])[:, None, None], moved @ flange, flange)


Error = Callable[[Array, Array, Array, Array, NDArray[np.bool_], Array, Flaw], Array]


def _spot(
    s: Array, slope: Array, _1: Array, _2: Array, _3: NDArray[np.bool_], _4: Array, flaw: Flaw
) -> Array:
    """Depth at which a spot is read, in widths of it: that of its near edge, or its light's mean.

    The light comes from a little behind the finder's face and falls off as the square of the way.
    """
    steep = np.linalg.norm(slope, axis=1)
    depth = GRID * ((1.0 + 0.5 * s) * steep)[:, None]  # of each ray beyond the middle one
    light = np.exp(-0.5 * GRID**2) / (BEHIND + s[:, None] + 0.02 * depth) ** 2
    if flaw.form["edge"][0]:
        share = np.cumsum(light, axis=1) / light.sum(axis=1, keepdims=True)
        first = np.argmax(share > NEAR, axis=1)
        return np.asarray(depth[np.arange(len(s)), first])
    return np.asarray(np.sum(light * depth, axis=1) / light.sum(axis=1))


ERRORS: Mapping[str, Error] = {
    "range_scale": lambda s, *_: s,
    "incidence_bias": _spot,
    "cyclic": lambda s, _1, _2, _3, _4, _5, f: np.sin(2 * np.pi * s / f.form["period"]),
    "leaning_board": lambda s, _1, p, t, mine, _5, f: np.where(
        mine & (t > f.form["moment"]), 2.0 * p[:, 0], 0.0
    ),
    "stripes": lambda s, _1, p, _3, mine, _5, f: np.where(
        mine, np.sign(np.sin(2 * np.pi * p[:, 0] / f.form["period"])), 0.0
    ),
    "cubed_tilt": lambda s, sl, _2, _3, _4, n, f: (n @ f.form["way"]) ** 3,
}

r"""What is wrong with a range finder, its boards or its arm, in forms of their own.

A slanted spot is read by its light: a Gaussian spot of rays, each returning the less the farther it
went, is averaged ray by ray; the spot widens with the range. A board bulges as a spherical cap. A
finder's clock runs fast; joints stand off, turn unevenly or twist under load; a base is bumped. Of
what no library lists: a phase finder's cyclic error, a cold finder that warms up, a board that
comes to lean, stripes of paint, a tilt that tells left from right by its cube.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Array, forward, load_torque, placed, rotations
from plumbline.experiments.reality.parts.room import PACE, Cap, Room, meet, rays

BEHIND = 0.3  # where the light comes from [m behind the face]
NEAR = 0.1  # share of the light at which an edge is seen
GRID = np.linspace(-2.5, 2.5, 61)  # rays across a spot [its standard deviations]
OF_ARM = ("joint_offset", "transmission_ripple", "joint_compliance")
OF_ROOM = ("range_scale", "incidence_bias", "plane_unflatness", "base_bump")
BEYOND = ("cyclic", "leaning_board", "stripes", "cubed_tilt")


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
        "way": _unit(rng.normal(size=3)),
        "turn": _unit(rng.normal(size=3)),
        "moment": rng.uniform(0.3, 0.7, 1) * rows * PACE,
        "foot": rng.uniform(0.35, 0.6, 1),
        "middle": rng.uniform(-0.1, 0.1, 2),
        "edge": rng.integers(0, 2, 1).astype(float),
        "period": rng.uniform(0.1, 0.2, 1),
    }
    element = None
    if name in OF_ARM:
        last = 5 if name == "joint_compliance" else n  # a wrist holds nothing that twists it
        element = int(rng.integers(2, last))  # not the first or last: planes and beam hide those
    if name in ("plane_unflatness", "leaning_board", "stripes"):
        element = int(rng.integers(1, boards + 1))
    return Flaw(name, element, form)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


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

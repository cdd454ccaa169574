r"""A case of either kind, drawn by its seed: a recording's folder, and apart from it the truth.

The size of what is wrong is set by what it leaves once beam and planes, or the rigid transform, are
fitted again: so many times the noise, by a linear fit of its own.

Of ranges the room is :mod:`.room`. A head carries markers: where a CT has them, and where a robot
touches them again and again,

.. math:: y = R\,c + t + e, \qquad e \sim N(0, \sigma^2 I)

What is wrong with CT changes c before it is written down; what moves while the robot touches
changes y. Breathing is the cube of half a sine: long at one end, short at the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Arm, Array, placed, rotations
from plumbline.experiments.reality.chances import unit
from plumbline.experiments.reality.parts import room as rooms
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.ranging.writing import flange_columns
from plumbline.experiments.reality.recorder import Recording, numbered, robot_lines, write

RANGES = Ranges("part")
RANGE_NOISE, TOUCH_NOISE = 0.05e-3, 0.3e-3  # 1 sigma [m]
STEP = 1e-6  # of a nuisance, for its derivative [m or rad]
ROUNDS = 12  # until a size gives the gap that is asked for
OF_HEAD = ("marker_shift", "slice_quantisation", "ct_scale", "respiration", "base_bump")
BEYOND = ("sheared_gantry", "sagging_table", "stretched_skin", "creeping_marker")
AXES = (0.075, 0.095, 0.085)  # half axes of a head [m]


@dataclass(frozen=True, eq=False)
class Truth:
    """What is wrong: the effect's name and element, None if nothing is; and the gap [noise]."""

    name: str | None
    element: int | None
    gap: float
    frame: Array | None = None  # of fiducials: (4, 4) from CT to the robot [m]
    beam: tuple[Array, Array] | None = None  # of ranges: origin [m] and way (3,) in the flange


@dataclass(frozen=True)
class RangePlan:
    """How ranges are taken: rows, motions, and whether poses are written in place of joints."""

    rows: int = 300
    motions: int = 10
    poses: bool = False


def draw_ranges(
    folder: Path, arm: Arm, name: str | None, gap: float, seed: int, given: RangePlan | None = None
) -> Truth:
    """Write a recording of ranges with one thing wrong, left at ``gap`` times the noise."""
    given = given or RangePlan()
    rng = np.random.default_rng([seed, 41])
    room = rooms.draw_room(arm, rng)
    q, board = rooms.plan(room, given.rows, rng)
    flaw = None if name is None else rooms.draw_flaw(name, room, len(q), rng)
    ideal = rooms.ranges(room, q, board)
    hidden = _beam_and_boards(room, q, board)
    size = 0.0
    if flaw is not None:
        size = _sized(
            lambda s: rooms.ranges(room, q, board, flaw, s) - ideal, hidden, gap * RANGE_NOISE
        )
    read = rooms.ranges(room, q, board, flaw, size) + RANGE_NOISE * rng.normal(size=len(q))
    columns: dict[str, Any] = flange_columns(arm, q) if given.poses else numbered("q", q)
    motion = np.arange(len(q)) * given.motions // len(q) + 1
    columns |= {"range": read, "plane": board + 1, "motion": motion}
    columns["time"] = rooms.PACE * np.arange(len(q))
    lines = [f'name = "{folder.name}"', 'observation = "plane_range"', f"noise_std = {RANGE_NOISE}"]
    lines += [] if given.poses else robot_lines(arm)
    write(folder, Recording("\n".join(lines) + "\n", columns))
    element = None if flaw is None else flaw.element
    return Truth(name, element, gap if name else 0.0, beam=(room.r, room.v))


def draw_reached(
    folder: Path, arm: Arm, name: str | None, gap: float, seeds: Iterable[int], given: RangePlan
) -> Truth:
    """The same by the first seed in whose room the arm reaches all boards, refused if none."""
    for seed in seeds:
        with suppress(ValueError):
            return draw_ranges(folder, arm, name, gap, seed, given)
    raise PlumblineError("no room in which the arm reaches all boards; take another seed")


def draw_fiducials(
    folder: Path, name: str | None, gap: float, seed: int, markers: int = 8, touches: int = 5
) -> Truth:
    """Write a recording of fiducials with one thing wrong, left at ``gap`` times the noise."""
    rng = np.random.default_rng([seed, 43])
    head = draw_head(rng, markers, touches)
    wrong = None if name is None else draw_wrong(name, head, rng)
    size = 0.0
    if wrong is not None:
        hidden = _rigid(head)
        size = _sized(lambda s: _off(head, wrong, s), hidden, gap * TOUCH_NOISE)
    ct, y = written(head, wrong, size)
    y = y + TOUCH_NOISE * rng.normal(size=y.shape)
    columns: dict[str, Any] = {
        "label": np.array([f"M{k + 1}" for k in head.marker]),
        "role": np.array(["marker"] * len(y)),
    }
    columns |= {f"ct_{c}": x for c, x in zip("xyz", np.round(ct[head.marker], 7).T, strict=True)}
    columns |= {f"robot_{c}": x for c, x in zip("xyz", y.T, strict=True)}
    columns["time"] = head.time
    lines = [f'name = "{folder.name}"', 'observation = "fiducials"', f"noise_std = {TOUCH_NOISE}"]
    write(folder, Recording("\n".join(lines) + "\n", columns))
    # Markers are numbered as they are first met in the file.
    order = list(dict.fromkeys(head.marker.tolist()))
    element = None if wrong is None or wrong.element is None else order.index(wrong.element - 1) + 1
    return Truth(name, element, gap if name else 0.0, placed(head.R, head.t))


def _sized(error: Callable[[float], Array], hidden: Array, wanted: float) -> float:
    """The size at which what is left of an error is as large as wanted, root mean square [m]."""
    basis, sizes, _ = np.linalg.svd(hidden, full_matrices=False)
    Q = basis[:, sizes > 1e-6 * sizes.max()]
    size = wanted
    for _ in range(ROUNDS):
        e = error(size).ravel()
        left = float(np.sqrt(np.mean((e - Q @ (Q.T @ e)) ** 2)))
        if abs(left / wanted - 1.0) < 0.01:
            break
        size *= float(np.clip(wanted / max(left, 1e-12), 0.1, 10.0))
    return size


def _beam_and_boards(room: rooms.Room, q: Array, board: NDArray[np.int64]) -> Array:
    """What ranges change by with beam and boards (N, 5 + 3 K)."""
    found = []
    for k in range(3):
        step = STEP * np.eye(3)[k]
        v = room.v + step
        changed = [replace(room, r=room.r + step), replace(room, v=v / np.linalg.norm(v))]
        for b in range(len(room.middles)):
            middles, axes = room.middles.copy(), room.axes.copy()
            if k < 2:
                axes[b, :, 2] += STEP * axes[b, :, k]
            else:
                middles[b] += STEP * axes[b, :, 2]
            changed.append(replace(room, middles=middles, axes=axes))
        found += [rooms.ranges(one, q, board) for one in changed]
    ideal = rooms.ranges(room, q, board)
    return np.stack([(one - ideal) / STEP for one in found], axis=1)


def _rigid(head: Head) -> Array:
    """What touches change by with a rigid motion (3 N, 6)."""
    y = written(head, None, 0.0)[1]
    about = y - y.mean(axis=0)
    turns = [np.cross(axis, about).ravel() for axis in np.eye(3)]
    return np.stack([*(np.tile(axis, len(y)) for axis in np.eye(3)), *turns], axis=1)


def _off(head: Head, wrong: Any, size: float) -> Array:
    """By how much touches miss what CT says, in the robot's frame (N, 3) [m]."""
    ct, y = written(head, wrong, size)
    return np.asarray(y - (ct[head.marker] @ head.R.T + head.t))


@dataclass(frozen=True, eq=False)
class Head:
    """Markers (K, 3) [m], the touches' markers (N,) from 0 and times (N,) [s], CT to robot."""

    markers: Array
    marker: NDArray[np.int64]
    time: Array
    R: Array
    t: Array


def draw_head(rng: np.random.Generator, markers: int, touches: int) -> Head:
    """Markers spread over the upper half of a head, touched in rounds at an uneven pace."""
    way = rng.normal(size=(markers, 3))
    way[:, 2] = np.abs(way[:, 2])
    place = np.array(AXES) * way / np.linalg.norm(way, axis=1, keepdims=True)
    order = np.concatenate([rng.permutation(markers) for _ in range(touches)])
    time = np.cumsum(RANGES.many("touch", rng, len(order)))
    R = rotations(rng.normal(size=3))
    return Head(place, order.astype(np.int64), time, R, RANGES.many("head", rng, 3))


def draw_wrong(name: str, head: Head, rng: np.random.Generator) -> rooms.Flaw:
    """A thing wrong of that name."""
    way = np.array(unit(rng))
    marked = name in ("marker_shift", "creeping_marker")
    element = int(rng.integers(1, len(head.markers) + 1)) if marked else None
    form = {
        "way": way,
        "period": RANGES.many("breath", rng, 1),
        "moment": RANGES.many("moment", rng, 1) * head.time.max(),
        "axis": rng.integers(0, 4, 1).astype(float),
        "spot": head.markers[rng.integers(len(head.markers))],
    }
    return rooms.Flaw(name, element, form)


def written(head: Head, wrong: rooms.Flaw | None, size: float) -> tuple[Array, Array]:
    """Places in CT (K, 3) as written down, and touches (N, 3) without noise [m]."""
    ct = head.markers.copy()
    if wrong is not None:
        ct = _in_ct(ct, wrong, size)
    at = head.markers[head.marker]
    if wrong is not None and wrong.name == "marker_shift":
        at = at + (head.marker + 1 == wrong.element)[:, None] * size * wrong.form["way"]
    y = at @ head.R.T + head.t
    if wrong is not None:
        y = y + size * _while_touching(head, wrong)
    return ct, y


def _in_ct(ct: Array, wrong: rooms.Flaw, size: float) -> Array:
    if wrong.name == "slice_quantisation" and size:
        ct[:, 2] = size * np.floor(ct[:, 2] / size)
    if wrong.name == "ct_scale":
        axis = int(wrong.form["axis"][0])
        wide = slice(None) if axis == 3 else axis
        ct[:, wide] = ct[:, wide] / (1.0 + size)
    if wrong.name == "sheared_gantry":
        ct[:, 1] += np.tan(size) * ct[:, 2]
    if wrong.name == "sagging_table":
        ct[:, 1] += size * (ct[:, 2] / 0.08) ** 2 * np.sign(wrong.form["way"][0])
    if wrong.name == "stretched_skin":
        far = np.linalg.norm(ct - wrong.form["spot"], axis=1)
        ct = ct + size * np.exp(-0.5 * (far / 0.06) ** 2)[:, None] * wrong.form["way"]
    return ct


def _while_touching(head: Head, wrong: rooms.Flaw) -> Array:
    time = head.time
    share = np.zeros(len(time))
    if wrong.name == "respiration":
        share = np.abs(np.sin(np.pi * time / wrong.form["period"])) ** 3
    if wrong.name == "base_bump":
        share = (time > wrong.form["moment"]).astype(float)
    if wrong.name == "creeping_marker":
        share = (head.marker + 1 == wrong.element) * (time / time.max())
    return share[:, None] * wrong.form["way"]

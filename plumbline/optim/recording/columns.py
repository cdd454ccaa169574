r"""Which columns of ``samples.csv`` mean what: ``q1..qn``, the measured ones, the context.

A folder may record every movable joint of its robot, or only those of the chain to the tip; the
numbers of ``q`` say which, and ``m``, ``direction``, ``velocity`` and ``effort`` follow them.

Couplings that are known: joints that mimic another, and readings that another joint moves.

.. math:: q_m = k\, q_j + c \quad\text{(mimic joints of a URDF)}, \qquad
          q_i \leftarrow q_i + k\, q_j \quad\text{(``[robot] couplings'')}

Both are the robot as it is meant to be; what deviates from them is a ``joint_coupling``.

Noise that differs from axis to axis and from row to row, as one number and a shape about it.

.. math:: \sigma_{na} = \sigma\, s_{na}, \qquad \frac1{N k} \sum_{n,a} s_{na}^2 = 1

A residual is divided by its shape, so that all of them have the one noise :math:`\sigma` again.

Rows to come in the columns of a recording's own file: the inverse of how columns are read.

A joint that follows another has no column of its own where the file holds the others alone; where
the one that it follows is no joint of the chain, that one's column tells where it is to be. What
known couplings add to a reading is taken off again.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError, fault, shown
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.linkage import Mimic, mimics_of
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.constants import LARGEST, TIP_AXES
from plumbline.optim.recording.kinds import ELSEWHERE, KINDS, ROWS
from plumbline.optim.recording.settings import Section, torque_constants
from plumbline.optim.recording.table import Array, Origin, Table, as_integers

JOINTWISE = ("direction", "velocity", "acceleration", "effort")
FORCE = ("force_x", "force_y", "force_z")
SCALAR = ("time", "temperature", "payload", "group", "held_out", "socket")


@dataclass(frozen=True)
class Joints:
    """The numbers (n) of the chain's joints among ``count`` numbered columns, from 1."""

    numbers: tuple[int, ...]
    count: int

    @property
    def names(self) -> tuple[str, ...]:
        """Their columns ``q...``."""
        return self.columns("q")

    def columns(self, prefix: str) -> tuple[str, ...]:
        """Their columns of another kind."""
        return tuple(f"{prefix}{number}" for number in self.numbers)

    def all_columns(self, prefix: str) -> tuple[str, ...]:
        """Columns of every recorded joint."""
        return tuple(f"{prefix}{number}" for number in range(1, self.count + 1))


def numbered(names: Iterable[str], prefix: str) -> set[int]:
    """Numbers k of the columns ``{prefix}k``."""
    found = (re.fullmatch(rf"{prefix}(0|[1-9][0-9]{{0,3}})", name) for name in names)
    return {int(match[1]) for match in found if match}


def joint_columns(table: Table, robot: Robot, chain: Chain) -> Joints:
    """The columns of the chain's joints (PlumblineError: others than it, or the robot, has)."""
    there = numbered(table.columns, "q")
    movable = [str(name) for name in robot.model.names][1:]
    if 0 in there:
        where = f"{table.origin.file}, row 1, column 'q0'"
        raise fault(where, "joints counted from 0", "q1, q2, ...", "count them from 1")
    if not there:
        table.require(["q1"])
    table.require(f"q{k}" for k in range(1, max(there)))
    count = max(there)
    if count == chain.n:
        return Joints(tuple(range(1, count + 1)), count)
    if count == len(movable):
        return Joints(tuple(movable.index(name) + 1 for name in chain.joint_names), count)
    raise _wrong_count(table, chain, count, len(movable))


def _wrong_count(table: Table, chain: Chain, count: int, movable: int) -> PlumblineError:
    expected = f"q1..q{chain.n} for {', '.join(chain.joint_names)}"
    if movable != chain.n:
        expected += f", or q1..q{movable} for every joint of the robot"
    where = f"{table.origin.file}, row 1, column 'q{count}'"
    mend = f"{'add' if count < chain.n else 'delete'} columns or mend [robot] tip_frame"
    return fault(where, f"{count} joint columns", expected, mend)


def measured_columns(
    table: Table, observation: str, joints: Joints, settings: Section
) -> tuple[Array | None, tuple[int, ...]]:
    """What was measured (N, m), if columns hold it, and the joints (from 0) that it is of.

    A column that is missing or holds no numbers is refused.
    """
    if observation == "fixed_point":
        table.require(["socket"])
        return None, ()
    if observation == "joint_position":
        return _encoders(table, joints, settings)
    if observation == "joint_torque":
        count = len(joints.names)
        efforts = table.block(joints.columns("effort")) * torque_constants(settings, count)
        return efforts, tuple(range(count))
    return table.block(KINDS[observation].columns), ()


def _encoders(table: Table, joints: Joints, settings: Section) -> tuple[Array, tuple[int, ...]]:
    """Second encoders: those in ``measured_joints``, else every column that is not empty."""
    wanted = settings.integers("measured_joints")
    table.require(["m1"] if wanted is None and not numbered(table.columns, "m") else [])
    names = joints.columns("m")
    if wanted is None:
        filled = (any(map(str.strip, table.columns.get(name, ()))) for name in names)
        seen = tuple(j for j, has_any in enumerate(filled) if has_any)
    else:
        if not set(wanted) <= set(range(1, joints.count + 1)) or len(set(wanted)) != len(wanted):
            expected = f"different numbers of joints from 1 to {joints.count}"
            raise settings.fault("measured_joints", expected, "joints count from 1")
        seen = tuple(j for j, number in enumerate(joints.numbers) if number in wanted)
    if not seen:
        where = f"{table.origin.file}, column {names[0]!r}"
        raise fault(where, "no second encoder read", "one or more columns m", "fill the columns")
    values = np.full((len(table), len(names)), np.nan)
    values[:, seen] = table.block([names[j] for j in seen])
    return values, seen


def context_columns(table: Table, joints: Joints, observation: str) -> dict[str, Any]:
    """The optional columns that are there, refused if incomplete or no numbers."""
    scalar, jointwise = _context_of(observation)
    values: dict[str, Any] = {name: table.numbers(name) for name in scalar if name in table}
    for name in ("socket", "group", "held_out"):
        if name in values:
            values[name] = as_integers(values[name], name, table.origin)
    for prefix in jointwise:
        if numbered(table.columns, prefix):
            values[prefix] = table.block(joints.columns(prefix))
    if "noise_std" in table:
        values["noise_rows"] = table.numbers("noise_std")
    if any(name in table for name in FORCE):
        values["force"] = table.block(FORCE)
    return values


def known_columns(joints: Joints, observation: str) -> tuple[str, ...]:
    """Every column that a recording of this kind may have, of joints outside of the chain, too."""
    scalar, _ = _context_of(observation)
    jointwise = ("q", *JOINTWISE, *(["m"] if observation == "joint_position" else []))
    of_joints = (name for prefix in jointwise for name in joints.all_columns(prefix))
    return (*ROWS[observation].columns, *of_joints, *scalar, "noise_std", *FORCE)


def _context_of(observation: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Optional columns of a kind, and of each joint: sockets and efforts are not, of their own."""
    scalar = tuple(name for name in SCALAR if name != "socket" or observation == "fixed_point")
    jointwise = tuple(n for n in JOINTWISE if n != "effort" or observation != "joint_torque")
    return scalar, jointwise


def elsewhere_columns(table: Table, observation: str) -> None:
    """Refuse a recording for another command that lacks a column of its kind."""
    kind = ELSEWHERE[observation]
    table.require(kind.columns)
    for prefix in kind.prefixes:
        if not numbered(table.columns, prefix):
            table.require([f"{prefix}1"])


MOVING = ("velocity", "acceleration")  # that follow with the multiplier alone
PER_JOINT = ("q", *MOVING, "direction", "effort", "m")  # columns numbered by joint


def with_mimics(table: Table, robot: Robot, chain: Chain) -> Table:
    """The table with columns of the joints that follow others, where it holds the others alone.

    It has ``q1..qk``, one for each joint of the robot, or of its chain, that moves on its own, in
    the model's order; as many columns as the chain has joints are of those.
    """
    mimics = mimics_of(robot.urdf)
    whole = tuple(str(name) for name in robot.model.names)[1:]
    count = sum(f"q{k}" in table for k in range(1, len(whole) + 1))
    for movable in (whole, chain.joint_names):
        free = [name for name in movable if name not in mimics]
        if len(free) < len(movable) and len(free) == count != chain.n:
            return _filled(table, movable, free, mimics)
    return table


def _filled(
    table: Table, movable: Sequence[str], free: Sequence[str], mimics: dict[str, Mimic]
) -> Table:
    """The table of the free joints with columns of all that move."""
    place = {name: k for k, name in enumerate(free, start=1)}
    columns, called = dict(table.columns), {}
    for prefix in PER_JOINT:
        if f"{prefix}1" not in table:
            continue
        for k in range(1, len(free) + 1):
            columns.pop(f"{prefix}{k}", None)
        for number, name in enumerate(movable, start=1):
            columns[f"{prefix}{number}"] = _cells(table, prefix, name, place, mimics)
            moved_by = place.get(name) or place.get(mimics[name][0], number)
            called[f"{prefix}{number}"] = f"{prefix}{moved_by}"
    return replace(table, columns=columns, origin=replace(table.origin, columns=called))


def as_counted(table: Table, joints: Joints) -> Mapping[str, str]:
    """What the file calls columns of joints, by those of the chain, where they differ."""
    each = [(p, j, k) for p in PER_JOINT for j, k in enumerate(joints.numbers, start=1)]
    called = {f"{p}{j}": table.origin.column(f"{p}{k}") for p, j, k in each}
    return {ours: theirs for ours, theirs in called.items() if ours != theirs}


def counted_otherwise(called: Mapping[str, str]) -> Iterator[str]:
    """A note on which joint is which column, where the chain counts otherwise than the file."""
    if other := [f"{ours[1:]} with {theirs}" for ours, theirs in called.items() if ours[0] == "q"]:
        yield f"joints are counted along the chain: joint {', '.join(other)}"


def _cells(
    table: Table, prefix: str, name: str, place: dict[str, int], mimics: dict[str, Mimic]
) -> Sequence[str]:
    """A joint's own cells, or what follows from those of the joint that it mimics."""
    if name in place:
        return table.columns[f"{prefix}{place[name]}"]
    leader, k, c = mimics[name]
    if leader not in place or prefix in ("effort", "m"):
        return ["" if prefix == "m" else "0"] * len(table)
    values = table.numbers(f"{prefix}{place[leader]}")
    follow = {"q": k * values + c, "direction": np.sign(k) * values}
    return [repr(float(v)) for v in follow.get(prefix, k * values)]


def coupled(values: Array, numbers: Sequence[int], settings: Section) -> Array:
    """Readings or velocities (N, n) of joints, by their numbers in the file, and what others."""
    section = settings.section("robot")
    found = values.copy()
    entries = section.values.get("couplings", [])
    for entry in entries if isinstance(entries, list) else [entries]:
        if not _is_coupling(entry, numbers):
            expected = f"[joint, by, gain] of two joints of the chain, not {shown(entry)}"
            raise section.fault("couplings", expected, "write couplings = [[5, 4, -0.5]]")
        joint, by, gain = entry
        found[:, list(numbers).index(joint)] += gain * values[:, list(numbers).index(by)]
    return found


def _is_coupling(entry: object, numbers: Sequence[int]) -> TypeGuard[list[Any]]:
    if not isinstance(entry, list) or len(entry) != 3 or entry[0] == entry[1]:
        return False
    gain = isinstance(entry[2], int | float) and not isinstance(entry[2], bool)
    return gain and all(type(j) is int and j in numbers for j in entry[:2])


def with_noise_shape(
    context: dict[str, Any], observation: str, rows: int, joints: int, origin: Origin
) -> dict[str, Any]:
    """The context with ``noise_axes`` and ``noise_rows`` made into ``noise_std`` and its shape.

    They (k,) and (N,) are 1 sigma of an axis [m, or rad or m of a joint]; given both, the axes'
    ratios count. The joints' second encoders or efforts are the axes of their kinds.
    """
    axes, each = context.pop("noise_axes", None), context.pop("noise_rows", None)
    if axes is None and each is None:
        return context
    size = joints if observation in ("joint_position", "joint_torque") else TIP_AXES
    key = origin.key("noise_std")
    across = np.ones(size) if axes is None else _positive(axes, size, lambda _: key)
    at = (lambda k: origin.at("noise_std", k)) if origin.lines is not None else lambda _: key
    along = np.ones(rows) if each is None else _positive(each, rows, at)
    if observation not in ("tip_position", "pose", "joint_position") and axes is not None:
        found = f"{size} axes of {observation}"
        raise fault(key, found, "one number", "its axes are not an instrument's")
    spread = np.sqrt(np.mean(across**2))
    whole = float(spread if each is None else np.sqrt(np.mean(along**2)))
    ratio = np.outer(along / np.sqrt(np.mean(along**2)), across / spread)
    if observation == "pose":  # of rotations the axes are not told apart
        ratio = np.hstack([ratio, np.tile(ratio.mean(axis=1, keepdims=True), 3)])
    return {**context, "noise_std": whole, "noise_shape": ratio}


def _positive(values: ArrayLike, size: int, at: Callable[[int], str]) -> Array:
    """So many positive numbers, each of which stands at some place."""
    array = np.asarray(values, dtype=float)
    if array.shape != (size,):
        found, mend = f"{array.size} numbers", "give one for each axis or row, or one for all"
        raise fault(at(0), found, f"{size}", mend)
    broken = np.flatnonzero(~((array > 0.0) & (array < LARGEST)))
    if len(broken):
        found = shown(float(array[broken[0]]))
        raise fault(at(int(broken[0])), found, "a positive number", "give 1 sigma")
    return array


def as_in_file(
    table: Table, robot: Robot, chain: Chain, settings: Section, rows: Mapping[str, Array]
) -> dict[str, Array]:
    """Columns (N,) by their names in the file, of what joints do (N, n) by prefix: ``q`` and so on.

    ``table`` is the file's own, as it was read.
    """
    whole = with_mimics(table, robot, chain)
    numbers, own = joint_columns(whole, robot, chain).numbers, whole is table
    adds = coupled(np.eye(chain.n), numbers, settings)
    found: dict[str, Array] = {}
    for prefix, values in rows.items():
        read = values @ np.linalg.inv(adds) if prefix in ("q", "velocity") else values
        for j, moved in _leaders_last(robot, chain, prefix, read, own=own):
            found[whole.origin.column(f"{prefix}{numbers[j]}")] = moved
    return found


def _leaders_last(
    robot: Robot, chain: Chain, prefix: str, values: Array, *, own: bool
) -> Iterator[tuple[int, Array]]:
    """Joints (from 0) with what their columns hold (N,); ``own`` where each has one."""
    mimics = {} if own else mimics_of(robot.urdf)
    names = chain.joint_names
    for j in sorted(range(chain.n), key=lambda j: names[j] not in mimics):
        _, times, zero = mimics.get(names[j], ("", 1.0, 0.0))
        led = (values[:, j] - (zero if prefix == "q" else 0.0)) / times
        yield j, np.sign(led) if prefix == "direction" else led

"""Columns of a range finder's recordings: the flange by joints or poses, ranges, labels.

The flange is given by joint readings ``q1..qn`` through the robot of ``dataset.toml``, or by its
pose ``px,py,pz,qw,qx,qy,qz`` [m, unit quaternion, scalar first] in the base frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plumbline.errors import fault, shown
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.robot import Robot
from plumbline.optim.hand_eye.constants import LARGEST_ANGLE, LONGEST
from plumbline.optim.recording.building import chain_to
from plumbline.optim.recording.columns import Joints, joint_columns
from plumbline.optim.recording.constants import UNIT_TOLERANCE
from plumbline.optim.recording.loading import Folder, open_folder, read_robot
from plumbline.optim.recording.origin import Array, Integers
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Table, as_integers, is_number
from plumbline.optim.rigid import rotations

NO_JOINTS = Joints((), 0)
POSE = ("px", "py", "pz", "qw", "qx", "qy", "qz")


@dataclass(frozen=True, eq=False)
class Flange:
    """Where the flange was, and what that came from."""

    T: Array  # poses (N, 4, 4) in the base frame [m]
    q: Array | None  # joint readings (N, n) [rad or m]; None where poses are given
    chain: Chain | None  # the robot's chain; None where poses are given
    used: tuple[str, ...]  # columns that were read
    data: bytes  # bytes of the robot's own files
    robot: Robot | None = None  # the robot; None where poses are given
    joints: Joints = NO_JOINTS  # its columns; none where poses are given


def open_ranges(
    folder: str | Path, observation: str, lacking: str, columns: tuple[str, ...] = ()
) -> tuple[Folder, Flange, Array]:
    """A folder of a range finder's readings: what it holds, the flange, and the ranges (N,) [m].

    Args:
        folder: Where it lies.
        observation: What its settings must say that it is.
        lacking: What a folder of another kind lacks.
        columns: That it must have beside the range.

    Raises:
        PlumblineError: The folder cannot be used; one line says where, why and how to mend it.
    """
    opened = open_folder(folder)
    opened.must_be(observation, lacking)
    table = opened.table
    table.require(("range", *columns))
    return opened, read_flange(opened.settings, opened.place, table), ranges(table)


def read_flange(settings: Section, place: Path, table: Table) -> Flange:
    """The flange's poses, by joints or as they stand.

    Raises:
        PlumblineError: Neither is there, or what is there is no pose.
    """
    by_pose = [name for name in POSE if name in table]
    if len(by_pose) == len(POSE) or (by_pose and "q1" not in table):
        table.require(POSE)
        return Flange(_poses(table), None, None, POSE, b"")
    if "q1" not in table:
        where = f"{table.origin.file}, row 1"
        mend = "add one of the two"
        raise fault(where, "no flange pose", f"q1, q2, ... or {','.join(POSE)}", mend)
    made = read_robot(settings, place)
    chain = chain_to(made.robot, made.tip_frame, settings.section("robot").where("tip_frame"))
    joints = joint_columns(table, made.robot, chain)
    q = table.block(joints.names)
    _check_angles(table, joints.names, q, chain)
    used = joints.all_columns("q")
    return Flange(chain.placement(q), q, chain, used, made.data, made.robot, joints)


def _check_angles(table: Table, names: tuple[str, ...], q: Array, chain: Chain) -> None:
    for j, name in enumerate(names):
        worst = int(np.argmax(np.abs(q[:, j])))
        if chain.kinds[j] == "revolute" and abs(q[worst, j]) > LARGEST_ANGLE:
            found, mend = shown(float(q[worst, j])), "looks like degrees: multiply by pi/180"
            raise fault(table.origin.at(name, worst), found, "an angle within two turns", mend)


def _poses(table: Table) -> Array:
    """Poses (N, 4, 4) from positions [m] and quaternions, scalar first."""
    values = table.block(POSE)
    lengths = np.linalg.norm(values[:, 3:], axis=1)
    broken = np.flatnonzero(np.abs(lengths - 1.0) > UNIT_TOLERANCE)
    if len(broken):
        found = f"a quaternion of length {lengths[broken[0]]:.4g}"
        where = table.origin.at("qw", broken[0])
        raise fault(where, found, "length 1", "order qw, qx, qy, qz; mend the row")
    far = np.flatnonzero(np.linalg.norm(values[:, :3], axis=1) > LONGEST)
    if len(far):
        found = f"{np.linalg.norm(values[far[0], :3]):.4g} m from the base"
        expected, mend = f"at most {LONGEST:g} m", "looks like millimetres: divide by 1000"
        raise fault(table.origin.at("px", far[0]), found, expected, mend)
    T = np.tile(np.eye(4), (len(values), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = rotations(values[:, 3:] / lengths[:, None]), values[:, :3]
    return T


def ranges(table: Table) -> Array:
    """Ranges (N,) [m], positive and in metres.

    Raises:
        PlumblineError: One that is not.
    """
    values = table.numbers("range")
    broken = np.flatnonzero(values <= 0.0)
    if len(broken):
        found, mend = shown(float(values[broken[0]])), "delete readings without an echo"
        raise fault(table.origin.at("range", broken[0]), found, "a range above 0 m", mend)
    long = np.flatnonzero(values > LONGEST)
    if len(long):
        found = shown(float(values[long[0]]))
        unit = (
            "looks like millimetres: divide by 1000" if len(long) > len(values) / 2 else "mend it"
        )
        raise fault(table.origin.at("range", long[0]), found, f"at most {LONGEST:g} m", unit)
    return values


def labelled(table: Table, name: str) -> tuple[Integers, tuple[str, ...]]:
    """Numbers (N,) of a column's labels, and the labels: numbers stay, words are counted from 1."""
    cells = [cell.strip() for cell in table.columns[name]]
    if any(is_number(cell) for cell in cells) or not all(c.isidentifier() for c in cells):
        numbers = as_integers(table.numbers(name), name, table.origin)
        return numbers, ()
    number = {label: k for k, label in enumerate(dict.fromkeys(cells), start=1)}
    return np.array([number[cell] for cell in cells], dtype=np.int64), tuple(number)

"""Which columns of ``samples.csv`` mean what: ``q1..qn``, the measured ones, the context.

A folder may record every movable joint of its robot, or only those of the chain to the tip; the
numbers of ``q`` say which, and ``m``, ``direction``, ``velocity`` and ``effort`` follow them.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError, fault
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.efforts import torque_constants
from plumbline.optim.recording.kinds import ELSEWHERE, KINDS
from plumbline.optim.recording.origin import Array
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Table, as_integers

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


@dataclass(frozen=True)
class Measured:
    """Measured values (N, m) or None, the joints they are of (from 0), and the columns read."""

    values: Array | None
    joints: tuple[int, ...]
    used: tuple[str, ...]


@dataclass(frozen=True)
class Context:
    """Optional arrays by attribute, and the columns read."""

    values: dict[str, Any]
    used: tuple[str, ...]


def numbered(names: Iterable[str], prefix: str) -> set[int]:
    """Numbers k of the columns ``{prefix}k``."""
    found = (re.fullmatch(rf"{prefix}(0|[1-9][0-9]{{0,3}})", name) for name in names)
    return {int(match[1]) for match in found if match}


def joint_columns(table: Table, robot: Robot, chain: Chain) -> Joints:
    """The columns of the chain's joints.

    Raises:
        PlumblineError: A number is missing, or there are neither as many as the chain has joints
            nor as many as the robot has.
    """
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


def measured_columns(table: Table, observation: str, joints: Joints, settings: Section) -> Measured:
    """What was measured (PlumblineError: a column is missing or holds no numbers)."""
    if observation == "fixed_point":
        table.require(["socket"])
        return Measured(None, (), ())
    if observation == "joint_position":
        return _encoders(table, joints, settings)
    if observation == "joint_torque":
        table.require(joints.columns("effort"))
        count = len(joints.names)
        efforts = table.block(joints.columns("effort")) * torque_constants(settings, count)
        return Measured(efforts, tuple(range(count)), joints.all_columns("effort"))
    names = KINDS[observation].columns
    return Measured(table.block(names), (), names)


def _encoders(table: Table, joints: Joints, settings: Section) -> Measured:
    """Second encoders: those in ``measured_joints``, else every column that is not empty."""
    wanted = settings.integers("measured_joints")
    table.require(["m1"] if wanted is None and not numbered(table.columns, "m") else [])
    names = joints.columns("m")
    if wanted is None:
        seen = tuple(j for j, name in enumerate(names) if name in table and not _empty(table, name))
    else:
        seen = _listed(wanted, joints, settings)
    if not seen:
        where = f"{table.origin.file}, column {names[0]!r}"
        raise fault(where, "no second encoder read", "one or more columns m", "fill the columns")
    values = np.full((len(table), len(names)), np.nan)
    for j in seen:
        values[:, j] = table.numbers(names[j])
    return Measured(values, seen, joints.all_columns("m"))


def _listed(wanted: tuple[int, ...], joints: Joints, settings: Section) -> tuple[int, ...]:
    if not set(wanted) <= set(range(1, joints.count + 1)) or len(set(wanted)) != len(wanted):
        expected = f"different numbers of joints from 1 to {joints.count}"
        raise settings.fault("measured_joints", expected, "joints count from 1")
    return tuple(j for j, number in enumerate(joints.numbers) if number in wanted)


def _empty(table: Table, name: str) -> bool:
    return not any(cell.strip() for cell in table.columns[name])


def context_columns(table: Table, joints: Joints, observation: str) -> Context:
    """The optional columns that are there.

    Raises:
        PlumblineError: One is incomplete, or holds no numbers.
    """
    values: dict[str, Any] = {}
    used: list[str] = []
    for name in [name for name in SCALAR if name in table]:
        if name == "socket" and observation != "fixed_point":
            continue
        values[name] = table.numbers(name)
        used.append(name)
    for name in ("socket", "group", "held_out"):
        if name in values:
            values[name] = as_integers(values[name], name, table.origin)
    for prefix in JOINTWISE:
        if prefix == "effort" and observation == "joint_torque":
            continue
        if numbered(table.columns, prefix):
            table.require(joints.columns(prefix))
            values[prefix] = table.block(joints.columns(prefix))
            used += joints.all_columns(prefix)
    if "noise_std" in table:
        values["noise_rows"] = table.numbers("noise_std")
        used.append("noise_std")
    if any(name in table for name in FORCE):
        values["force"] = table.block(FORCE)
        used += FORCE
    # Joints outside of the chain are known, too, and no surprise.
    return Context(values, (*used, *joints.all_columns("q")))


def elsewhere_columns(table: Table, observation: str) -> None:
    """Check that a recording for another command has the columns of its kind.

    Raises:
        PlumblineError: A column is missing.
    """
    kind = ELSEWHERE[observation]
    table.require(kind.columns)
    for prefix in kind.prefixes:
        if not numbered(table.columns, prefix):
            table.require([f"{prefix}1"])

"""Recordings of motions (``observation = "motion"``): what joints were told, and what they did.

``samples.csv`` has ``time`` [s], commands ``u1..un`` and measured positions ``q1..qn`` [rad, m];
``group`` (one motion of several) and ``held_out`` if wanted. ``[motion]`` says what a command is:
``command = "position"`` (the default; ``"smooth_position"`` runs smoothly between rows,
``"held_position"`` stands until the next: these are tried, too), ``"velocity"`` (smooth between
rows), ``"rate"`` (a velocity that is held until the next row), ``"torque"`` (held likewise) or
``"sampled_torque"`` (a row now and then of a loop that is much faster: straight between rows), and
the servo's gains ``kp`` [N m/rad] and ``kd`` [N m s/rad], one number or one a joint, where they are
known. Joints are those of the whole robot where there are as many columns, else those of the chain
to the tip frame.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault, shown
from plumbline.kinematics.law import Law
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.quantities import counted
from plumbline.optim.diagnosis.motion.carried import NOTHING, Carried
from plumbline.optim.diagnosis.motion.constants import (
    LEAP,
    LEAST_ROWS,
    LISTED_ROWS,
    ROUNDED,
    SMOOTHER,
)
from plumbline.optim.diagnosis.motion.set_up import doubted_units, refuse_wrong_set_up
from plumbline.optim.diagnosis.motion.units import slides
from plumbline.optim.recording import loading
from plumbline.optim.recording.columns import numbered
from plumbline.optim.recording.constants import FIRST_ROW
from plumbline.optim.recording.derivatives import elsewhere
from plumbline.optim.recording.recording import hash_of
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Array, Flags, Integers, Origin, Table, as_integers

OBSERVATION, TRACKING = "motion", "tracking"
OPTIONAL = ("velocity", "effort")  # read by other programs: positions alone are fitted


@dataclass(frozen=True, eq=False)
class MotionRecording:
    """Commands and measured positions of n joints over time.

    Attributes:
        name: What it is called.
        robot: The robot, with the recording's gravity.
        joints: Names of the joints (n).
        index: Their places among the coordinates of the robot's model (n).
        law: What a command is, and whether the servo's gains are known.
        time: Time (N,) [s].
        command: Commands (N, n) [rad, rad/s or N m].
        q: Measured positions (N, n) [rad or m].
        group: Motion (N,): what is left out together; None if there is one.
        held_out: Rows (N,) that no fit may see; None if there are none.
        kp: Known gains (n,) [N m/rad]; zeros where they are not.
        kd: Known dampings (n,) [N m s/rad].
        noise_std: Noise of a measured position, 1 sigma [rad]; None if unknown.
        sha256: Hash of the files' bytes, or of the arrays.
        notes: What is odd but no fault, one line each.
        lead: By how long positions were read, or worked out, after their rows' times, as far as
            that was found [s]: of one clock, of all joints.
        carried: What the tip carries that the robot's file lacks, as far as that was found.
    """

    name: str
    robot: Robot
    joints: tuple[str, ...]
    index: tuple[int, ...]
    law: Law
    time: Array
    command: Array
    q: Array
    group: Integers | None
    held_out: Flags | None
    kp: Array
    kd: Array
    noise_std: float | None = None
    sha256: str = ""
    notes: tuple[str, ...] = ()
    observation: str = OBSERVATION
    lead: float = 0.0
    carried: Carried = NOTHING

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.time)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @cached_property
    def slides(self) -> tuple[bool, ...]:
        """Which joints (n) slide; a tip's axes all do."""
        return slides(self.robot, self.index)

    @property
    def unit(self) -> str:
        """Unit of what is told of all joints: ``"rad"``, or ``"m"`` where all of them slide."""
        return "m" if all(self.slides) else "rad"

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint's measured position (n)."""
        return tuple("m" if one else "rad" for one in self.slides)

    @property
    def noun(self) -> str:
        """What has a drive: ``"joint"``, or ``"axis"``."""
        return "axis" if self.observation == TRACKING else "joint"

    def __repr__(self) -> str:
        """Name, rows, joints and what a command is."""
        return (
            f"<MotionRecording {self.name[:60]!r}: {len(self)} rows, {self.n} joints, {self.law}>"
        )

    def describe(self) -> str:
        """What is in it, a few lines of plain text."""
        seconds = float(np.median(np.diff(self.time)))
        lines = [
            f"Recording {self.name!r}",
            f"observation  {self.observation}, commands of {self.law}",
            f"rows         {len(self)}, {1 / seconds:.4g} a second",
            f"robot        {self.robot.name}: {', '.join(self.joints)}",
            f"sha256       {self.sha256[:12]}",
        ]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def build_motion(
    *,
    robot: Robot | str,
    time: ArrayLike,
    command: ArrayLike,
    q: ArrayLike,
    kind: str = "position",
    kp: ArrayLike | None = None,
    kd: ArrayLike | None = None,
    group: ArrayLike | None = None,
    held_out: ArrayLike | None = None,
    tip_frame: str | None = None,
    noise_std: float | None = None,
    name: str = "arrays",
) -> MotionRecording:
    """A checked motion from arrays.

    Args:
        robot: The robot, or the name of a bundled one.
        time: Time (N,) [s], ascending within a group.
        command: Commands (N, n) [rad, rad/s or N m].
        q: Measured positions (N, n) [rad or m].
        kind: What a command is: ``"position"``, ``"velocity"``, ``"rate"`` or ``"torque"``.
        kp: Gains of a servo on position, one or (n,) [N m/rad].
        kd: Its dampings, one or (n,) [N m s/rad].
        group: Motion (N,): what is left out together.
        held_out: Rows (N,) that no fit may see.
        tip_frame: End of the chain, where not all joints of the robot are given.
        noise_std: Noise of a measured position, 1 sigma [rad].
        name: What to call it.

    Raises:
        PlumblineError: The arrays cannot be used; the message says why and what to do.
    """
    robot = Robot.bundled(robot) if isinstance(robot, str) else robot
    t, u, measured = arrays = in_rows("time, command, q", time, command, q)
    joints, index = joints_of(robot, measured.shape[1], tip_frame, "q")
    gains = [
        np.broadcast_to(np.asarray(0.0 if k is None else k, float), u.shape[1]) for k in (kp, kd)
    ]
    return checked(
        Origin(), name=name, robot=robot, joints=joints, index=index,
        law=_law(kind, kp is not None, "kind"), time=t, command=u, q=measured,
        group=None if group is None else np.asarray(group, dtype=np.int64),
        held_out=None if held_out is None else np.asarray(held_out, dtype=bool),
        kp=gains[0], kd=gains[1], noise_std=noise_std,
        sha256=hash_of(*(a.tobytes() for a in arrays)), notes=(),
    )  # fmt: skip


def in_rows(called: str, *values: ArrayLike) -> tuple[Array, Array, Array]:
    """Times (N,), and what was told and read then (N, n), refused if of other shapes."""
    t, u, read = (np.asarray(one, dtype=float) for one in values)
    if read.ndim != 2 or u.shape != read.shape or t.shape != (len(read),):
        found = ", ".join(str(a.shape) for a in (t, u, read))
        raise fault(called, f"shapes {found}", "(N,), (N, n), (N, n)", "one row a time")
    return t, u, read


def load_motion(folder: str | Path, made: loading.RobotFiles | None = None) -> MotionRecording:
    """Read and check a recording of motions.

    Args:
        folder: The folder; it is never written to.
        made: The robot, where it is not the folder's own.

    Raises:
        PlumblineError: The folder cannot be used; one line says where, why and how to mend it.
    """
    opened = loading.open_folder(folder)
    opened.must_be(OBSERVATION, "commands")
    settings, table = opened.settings, opened.table
    section = settings.section(OBSERVATION)
    made = made or loading.read_robot(settings, opened.place)
    table.require(("time", "q1", "u1"))
    count = max(numbered(table.columns, "q"))
    names = [[f"{prefix}{k}" for k in range(1, count + 1)] for prefix in ("u", "q")]
    joints, index = joints_of(made.robot, count, made.tip_frame, f"{table.origin.file}, row 1, q1")
    flags = {k: whole(table, k) for k in ("group", "held_out")}
    used = ["time", *flags, *names[0], *names[1]]
    used += [f"{prefix}{k}" for prefix in OPTIONAL for k in range(1, count + 1)]
    notes = list(settings.unused((*loading.KEYS, *loading.PROVENANCE, "robot", OBSERVATION)))
    notes += section.unused(("command", "kp", "kd", "noise_std"))
    stated = section if "noise_std" in section.values else settings
    held = flags["held_out"]
    return checked(
        opened.origin, name=opened.name, robot=made.robot, joints=joints, index=index,
        law=_law(section.word("command") or "position", "kp" in section.values,
                 section.where("command")),
        time=table.numbers("time"), command=table.block(names[0]), q=table.block(names[1]),
        group=flags["group"], held_out=None if held is None else held == 1,
        kp=_gains(section, "kp", count), kd=_gains(section, "kd", count),
        noise_std=stated.number("noise_std"), sha256=opened.sha256(made.data),
        notes=(*notes, *table.notes, *table.unused(used)),
    )  # fmt: skip


def joints_of(
    robot: Robot, count: int, tip_frame: str | None, where: str
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Names of so many joints, and their places among the coordinates of the robot's model.

    Raises:
        PlumblineError: The robot has another number, and so has its chain to the tip frame.
    """
    every = [str(name) for name in robot.model.names][1:]
    chain = robot.chain(tip_frame).joint_names
    for names in (every, chain):
        if len(names) == count:
            return tuple(names), tuple(every.index(name) for name in names)
    expected = f"{len(every)} for every joint of the robot, or {len(chain)} for its chain"
    raise fault(where, f"{count} joint columns", expected, "add or delete columns")


def _law(command: str, gains: bool, where: object) -> Law:
    known = [law for law in Law if not law.known]
    if command not in known:
        mend = "name what the commands are"
        raise fault(str(where), shown(command), f"one of {', '.join(known)}", mend)
    return Law.SERVO if gains and command == Law.POSITION else Law(command)


def _gains(section: Section, key: str, count: int) -> Array:
    """Gains (n,) from a number or a list."""
    value = section.values.get(key, 0.0)
    listed = list(value) if isinstance(value, list) else [value] * count
    fine = all(isinstance(v, int | float) and not isinstance(v, bool) and v >= 0 for v in listed)
    if len(listed) != count or not fine:
        expected = f"a number, or {count} of them, none below 0"
        raise section.fault(key, expected, f"write {key} = 20.0")
    return np.array(listed, dtype=float)


def whole(table: Table, name: str) -> Integers | None:
    """A column of whole numbers (N,), if there is one."""
    return as_integers(table.numbers(name), name, table.origin) if name in table else None


def checked(origin: Origin, **given: Any) -> MotionRecording:
    """The recording, if its clock runs and its numbers can be angles.

    Raises:
        PlumblineError: They cannot.
    """
    r = MotionRecording(**given)
    if len(r) < LEAST_ROWS:
        raise fault(origin.file, f"{len(r)} rows", f"at least {LEAST_ROWS}", "record for longer")
    for name, values in (
        ("time", r.time[:, None]),
        ("u", r.command),
        (r.joints[0][0] if r.noun == "axis" else "q", r.q),
    ):
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            raise fault(origin.at(name, bad[0][0]), "no number", "a finite one", "delete the row")
    same = np.ones(len(r) - 1, bool) if r.group is None else np.diff(r.group) == 0
    back = np.flatnonzero((np.diff(r.time) <= 0) & same)
    if len(back):
        found = f"{r.time[back[0] + 1]:.9g} s after {r.time[back[0]]:.9g} s"
        twice = r.time[back[0] + 1] == r.time[back[0]]
        mend = "delete one of the two" if twice else "sort the rows"
        mend += ", or number the motions in a column 'group'"
        raise fault(origin.at("time", back[0] + 1), found, "ascending times", mend)
    if r.noise_std is not None and not 0.0 < r.noise_std < np.inf:
        mend = "delete it: then it is estimated"
        raise fault(origin.key("noise_std"), f"{r.noise_std:.4g}", "a noise above 0", mend)
    refuse_wrong_set_up(r, origin)
    if r.held_out is not None and (r.held_out.all() or not r.held_out.any()):
        found = "every row held out" if r.held_out.all() else "no row held out"
        raise fault(origin.at("held_out"), found, "some of them", "delete the column")
    r = replace(r, notes=(*r.notes, *doubted_units(r)))
    return _evenly(_without_leaps(_run_by_run(r)))


def _run_by_run(r: MotionRecording) -> MotionRecording:
    """Logs back to back are motions of their own: joints are elsewhere from a row to the next.

    A joint that follows positions gets there at once only if it is told so in that very row.
    """
    begins = elsewhere(r.q) & (elsewhere(r.command) if r.law.follows else True)
    begins[:-1] &= ~begins[1:]  # away and back is a reading's error
    if not begins.any():
        return r
    group = np.zeros(len(r), np.int64) if r.group is None else r.group
    anew = np.cumsum(np.append(False, begins | (np.diff(group) != 0)))
    begins &= np.diff(group) == 0
    if not begins.any():  # all of them are told already
        return r
    rows = ", ".join(map(str, np.flatnonzero(begins)[:LISTED_ROWS] + FIRST_ROW + 1))
    note = f"joints are elsewhere at once from rows {rows} on: motions of their own, as by 'group'"
    return replace(r, group=anew.astype(np.int64), notes=(*r.notes, note))


def _evenly(r: MotionRecording) -> MotionRecording:
    """By an even clock, where its stamps only jitter about one by which all runs more smoothly."""
    even, group = r.time.copy(), np.zeros(len(r)) if r.group is None else r.group
    runs = np.split(np.arange(len(r)), np.flatnonzero(np.diff(group) != 0) + 1)
    for run in (run for run in runs if len(run) > 2):
        even[run] = np.polyval(np.polyfit(run, r.time[run], 1), run)
    off, step = np.abs(even - r.time).max(), np.median(np.diff(even))
    if not ROUNDED * step < off < step or not _smoother(r, even):
        return r
    note = f"stamps jitter by up to {1e3 * off:.3g} ms about an even clock, which rows are taken by"
    return replace(r, time=even, notes=(*r.notes, note))


def _smoother(r: MotionRecording, even: Array) -> bool:
    """Whether readings run more smoothly by an even clock than by their stamps, beyond chance.

    Their noise is in both alike: row by row it is what differs that tells, three of them in one.
    """
    here, there = (_rough(r, time) for time in (even, r.time))
    usual = np.mean(here, axis=0) + _encoder_step(r.q) ** 2 / 12  # variance of what is rounded
    more = np.sum((there - here) / np.where(usual > 0.0, usual, np.inf), axis=1)
    return float(np.mean(more)) > SMOOTHER * float(np.std(more)) * (3 / len(more)) ** 0.5


def _rough(r: MotionRecording, time: Array) -> Array:
    """Squares of how far readings (N - 2, n) are off the line of both their neighbours.

    As a reading's own noise would have it. Commands may be even in rows whatever the clock: only
    what moves by itself tells.
    """
    apart = time[2:] - time[:-2]
    share = ((time[1:-1] - time[:-2]) / np.where(apart > 0.0, apart, 1.0))[:, None]
    off = r.q[1:-1] - (1.0 - share) * r.q[:-2] - share * r.q[2:]
    return np.asarray(off**2 / (1.0 + (1.0 - share) ** 2 + share**2))


def _encoder_step(q: Array) -> Array:
    """The least that readings (N, n) of each joint ever change by (n,); none where they do not."""
    step = np.abs(np.diff(q, axis=0))
    least = np.where(step > 0.0, step, np.inf).min(axis=0, initial=np.inf)
    return np.asarray(np.where(np.isfinite(least), least, 0.0))


def _without_leaps(r: MotionRecording) -> MotionRecording:
    """Put single readings that leap away and back, as no joint moves, between their neighbours.

    These are then off the line of their own neighbours by half as much, the other way.
    """
    q, off = r.q.copy(), np.zeros_like(r.q)
    off[1:-1] = q[1:-1] - (q[:-2] + q[2:]) / 2
    leaps = np.abs(off) > LEAP * np.maximum(np.abs(off).mean(axis=0), _encoder_step(r.q))
    for side in (-1, 1):
        leaps &= np.abs(np.roll(off, side, axis=0) + off / 2) < np.abs(off) / 4
    rows, columns = np.nonzero(leaps)
    q[rows, columns] -= off[rows, columns]
    told = [
        f"{r.noun} {j + 1} leaps away and back in {counted(len(at), 'row')}, taken for gross "
        f"errors: {', '.join(map(str, at[:LISTED_ROWS]))}{', ...' * (len(at) > LISTED_ROWS)}"
        for j in range(r.n)
        if len(at := rows[columns == j] + FIRST_ROW)
    ]
    return replace(r, q=q, notes=(*r.notes, *told))

"""Recordings of a range finder on planes (``observation = "plane_range"``), read and checked.

``samples.csv`` has ``range`` [m], ``plane`` and ``motion`` (numbers or words), and the flange
either by joint readings ``q1..qn`` through the robot of ``dataset.toml``, or by its pose
``px,py,pz,qw,qx,qy,qz`` [m, unit quaternion, scalar first] in the base frame. Optional: ``mark``
for readings that were aimed at marks, 1, 2, ... (0 elsewhere): they judge the calibration and take
no part in it; ``held_out`` (1: likewise left aside).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plumbline.errors import PlumblineError, fault, shown
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.frames import homogeneous
from plumbline.kinematics.robot import Robot
from plumbline.optim.hand_eye.accuracy import Marks
from plumbline.optim.hand_eye.constants import LARGEST_ANGLE, LARGEST_NOISE, LEAST_ROWS, LONGEST
from plumbline.optim.hand_eye.readings import Readings
from plumbline.optim.recording.building import chain_to
from plumbline.optim.recording.columns import Joints, context_columns, joint_columns, known_columns
from plumbline.optim.recording.constants import UNIT_TOLERANCE
from plumbline.optim.recording.loading import SAMPLES, Folder, open_folder, read_robot
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Array, Flags, Integers, Table, as_integers, is_number
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
    """A folder of a range finder (PlumblineError): what it holds, flange, and ranges (N,) [m]."""
    opened = open_folder(folder)
    opened.must_be(observation, lacking)
    table = opened.table
    table.require(("range", *columns))
    return opened, read_flange(opened.settings, opened.place, table), ranges(table)


def read_flange(settings: Section, place: Path, table: Table) -> Flange:
    """The flange's poses, by joints or as they stand, refused where there are none."""
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
        if chain.turning[j] and abs(q[worst, j]) > LARGEST_ANGLE:
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
    return homogeneous(rotations(values[:, 3:] / lengths[:, None]), values[:, :3])


def ranges(table: Table) -> Array:
    """Ranges (N,) [m], refused where they are not positive or not in metres."""
    values = table.numbers("range")
    mend = "delete readings without an echo"
    table.origin.refuse("range", values <= 0.0, values, "a range above 0 m", mend)
    long = values > LONGEST
    mend = "looks like millimetres: divide by 1000" if long.mean() > 0.5 else "mend it"
    table.origin.refuse("range", long, values, f"at most {LONGEST:g} m", mend)
    return values


def labelled(table: Table, name: str) -> tuple[Integers, tuple[str, ...]]:
    """Numbers (N,) of a column's labels, and the labels: numbers stay, words are counted from 1."""
    cells = [cell.strip() for cell in table.columns[name]]
    if any(is_number(cell) for cell in cells) or not all(c.isidentifier() for c in cells):
        numbers = as_integers(table.numbers(name), name, table.origin)
        return numbers, ()
    number = {label: k for k, label in enumerate(dict.fromkeys(cells), start=1)}
    return np.array([number[cell] for cell in cells], dtype=np.int64), tuple(number)


OBSERVATION = "plane_range"
OPTIONAL = ("mark", "held_out", "group", "time", "patch", "temperature")
TABLES = ("robot", "tool", "fit")
SETTINGS_KEYS = (
    "name", "observation", "noise_std", "incidence_bias_std",
    "description", "instrument", "source", "licence",
    "license", "citation", "sha256",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class EveryRow:
    """All rows but those aimed at marks, those held out among them, as they stand in the file."""

    readings: Readings  # flange, ranges, planes and motions (N)
    q: Array | None  # joint readings (N, n) [rad or m]; None where poses are given
    robot: Robot | None  # the robot; None where poses are given
    held_out: Integers  # rows that no fit may see (N,), 0 or 1
    # optional columns (N, ...) by the names that a Recording has for them
    context: Mapping[str, Array]
    always: tuple[str, ...] = ()  # effects that every model fits


@dataclass(frozen=True, eq=False)
class RangeRecording:
    """A recording of a range finder on planes."""

    name: str  # what it is called
    readings: Readings  # the readings that calibrate, their names being rows of the file
    labels: tuple[str, ...]  # what the planes are called, by their numbers
    marks: Marks | None  # readings of marks; None if there are none
    q: Array | None  # joint readings of the readings (N, n) [rad or m]; None where poses are given
    chain: Chain | None  # the robot's chain; None where poses are given
    noise_std: float | None  # noise of the range, 1 sigma [m]; None if unknown
    # standard deviation [m] of the bias of slanted beams over 1 / cos - 1; None if unknown
    incidence_bias_std: float | None
    held_out: Readings | None  # readings that no fit may see; None if there are none
    sha256: str  # hash of the files' bytes
    notes: tuple[str, ...]  # what is odd but no fault
    # all rows with their context, to be diagnosed; None of readings that were given
    every: EveryRow | None = None

    def __repr__(self) -> str:
        planes = f"{len(self.readings)} readings on {len(self.readings.planes)} planes"
        return f"<RangeRecording {self.name[:60]!r}: {planes}>"


def load_ranges(folder: str | Path) -> RangeRecording:
    """Read and check a recording of a range finder on planes, refused if it cannot be used."""
    opened, flange, distance = open_ranges(folder, OBSERVATION, "ranges", ("plane", "motion"))
    settings, table = opened.settings, opened.table
    plane, labels = labelled(table, "plane")
    motion, _ = labelled(table, "motion")
    mark, held = _marked(table), _held_out(table)
    context = context_columns(table, flange.joints, OBSERVATION)
    known = known_columns(flange.joints, OBSERVATION)
    used = ("plane", "motion", *flange.used, *OPTIONAL, *known)
    lines = table.origin.lines
    rows = np.arange(len(table)) if lines is None else lines
    fitted = (mark == 0) & (held == 0)
    _check_left(table, mark, held)
    every = Readings(flange.T[:, :3, :3], flange.T[:, :3, 3], distance, plane, motion, rows)
    return RangeRecording(
        name=opened.name,
        readings=_checked(every.select(fitted)),
        labels=labels,
        marks=_marks(flange.T, distance, mark),
        q=None if flange.q is None else flange.q[fitted],
        chain=flange.chain,
        noise_std=_noise(settings),
        incidence_bias_std=_bias(settings),
        held_out=every.select((held == 1) & (mark == 0)) if np.any(held == 1) else None,
        sha256=opened.sha256(flange.data),
        notes=(*settings.unused((*SETTINGS_KEYS, *TABLES)), *table.notes, *table.unused(used)),
        every=_every(every, flange, mark == 0, held, context, settings),
    )


def _every(
    readings: Readings,
    flange: Flange,
    kept: Flags,
    held: Integers,
    context: Mapping[str, Array],
    settings: Section,
) -> EveryRow:
    told = {name: v[kept] for name, v in context.items() if name != "held_out"}
    always = settings.section("fit").words("always") or ()
    q = None if flange.q is None else flange.q[kept]
    return EveryRow(readings.select(kept), q, flange.robot, held[kept], told, tuple(always))


def _whole(table: Table, name: str) -> Integers:
    """An optional column of whole numbers (N,), zeros where it is not there."""
    if name not in table:
        return np.zeros(len(table), dtype=np.int64)
    return as_integers(table.numbers(name), name, table.origin)


def _marked(table: Table) -> Integers:
    """Which mark each reading was aimed at (N,), 0 for none."""
    mark = _whole(table, "mark")
    mend = "number marks 1, 2, ..., and write 0 elsewhere"
    table.origin.refuse("mark", mark < 0, mark, "0 or a mark's number", mend)
    return mark


def _held_out(table: Table) -> Integers:
    """Which readings no fit may see (N,), 0 or 1."""
    held = _whole(table, "held_out")
    bad, mend = (held != 0) & (held != 1), "write 1 for a row that no fit may see"
    table.origin.refuse("held_out", bad, held, "0 or 1", mend)
    return held


def _check_left(table: Table, mark: Integers, held: Integers) -> None:
    """Refuse where marks and held-out rows leave too few readings to fit."""
    aimed, kept_back = int((mark > 0).sum()), int(((held == 1) & (mark == 0)).sum())
    left = len(table) - aimed - kept_back
    if left < LEAST_ROWS and (aimed or kept_back):
        found = f"{left} rows to fit ({kept_back} are held out, {aimed} are aimed at marks)"
        mend = "hold out or mark fewer rows, or take more"
        raise fault(table.origin.file, found, f"at least {LEAST_ROWS}", mend)


def _checked(r: Readings) -> Readings:
    try:
        return Readings.from_arrays(r.R, r.t, r.distance, r.plane, r.motion, r.row)
    except PlumblineError as error:
        raise PlumblineError(f"{SAMPLES}: {error}") from None


def _marks(T: Array, distance: Array, mark: Integers) -> Marks | None:
    rows = mark > 0
    if not rows.any():
        return None
    try:
        return Marks(T[rows, :3, :3], T[rows, :3, 3], distance[rows], mark[rows])
    except PlumblineError as error:
        raise PlumblineError(f"{SAMPLES}, column 'mark': {error}") from None


def _noise(settings: Section) -> float | None:
    value = settings.number("noise_std")
    if value is not None and not 0.0 < value < LARGEST_NOISE:
        expected = f"a noise in m between 0 and {LARGEST_NOISE:g}"
        raise settings.fault("noise_std", expected, "give 1 sigma in m")
    return value


def _bias(settings: Section) -> float | None:
    value = settings.number("incidence_bias_std")
    if value is not None and not 0.0 <= value < LARGEST_NOISE:
        mend = "give 1 sigma in m, over 1 / cos - 1 of the incidence"
        raise settings.fault("incidence_bias_std", f"a bias in m from 0 to {LARGEST_NOISE:g}", mend)
    return value

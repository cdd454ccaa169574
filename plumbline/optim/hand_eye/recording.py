"""Recordings of a range finder on planes (``observation = "plane_range"``), read and checked.

``samples.csv`` has ``range`` [m], ``plane`` and ``motion`` (numbers or words), and the flange
either by joint readings ``q1..qn`` through the robot of ``dataset.toml``, or by its pose
``px,py,pz,qw,qx,qy,qz`` [m, unit quaternion] in the base frame. Optional: ``mark`` for readings
that were aimed at marks, 1, 2, ... (0 elsewhere): they judge the calibration and take no part in
it; ``held_out`` (1: likewise left aside).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError, fault, shown
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.robot import Robot
from plumbline.optim.hand_eye.columns import Flange, labelled, open_ranges
from plumbline.optim.hand_eye.constants import LARGEST_NOISE, LEAST_ROWS
from plumbline.optim.hand_eye.readings import Readings
from plumbline.optim.hand_eye.repeatability import Marks
from plumbline.optim.recording.columns import context_columns
from plumbline.optim.recording.loading import SAMPLES
from plumbline.optim.recording.origin import Array, Integers
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Table, as_integers

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
        """Name, readings and planes."""
        planes = f"{len(self.readings)} readings on {len(self.readings.planes)} planes"
        return f"<RangeRecording {self.name[:60]!r}: {planes}>"


def load_ranges(folder: str | Path) -> RangeRecording:
    """Read and check a recording of a range finder on planes.

    Raises:
        PlumblineError: The folder cannot be used; one line says where, why and how to mend it.
    """
    opened, flange, distance = open_ranges(folder, OBSERVATION, "ranges", ("plane", "motion"))
    settings, table = opened.settings, opened.table
    plane, labels = labelled(table, "plane")
    motion, _ = labelled(table, "motion")
    mark, held = _marked(table), _held_out(table)
    context = context_columns(table, flange.joints, OBSERVATION)
    used = ("range", "plane", "motion", *flange.used, *OPTIONAL, *context.used)
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
        every=_every(every, flange, mark == 0, held, context.values, settings),
    )


def _every(
    readings: Readings,
    flange: Flange,
    kept: NDArray[np.bool_],
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
    """Which mark each reading was aimed at (N,), 0 for none.

    Raises:
        PlumblineError: A mark below zero, which would be neither aimed nor fitted.
    """
    mark = _whole(table, "mark")
    below = np.flatnonzero(mark < 0)
    if len(below):
        found, mend = shown(int(mark[below[0]])), "number marks 1, 2, ..., and write 0 elsewhere"
        raise fault(table.origin.at("mark", below[0]), found, "0 or a mark's number", mend)
    return mark


def _held_out(table: Table) -> Integers:
    """Which readings no fit may see (N,), 0 or 1.

    Raises:
        PlumblineError: Another number.
    """
    held = _whole(table, "held_out")
    odd = np.flatnonzero((held != 0) & (held != 1))
    if len(odd):
        where, found = table.origin.at("held_out", odd[0]), shown(int(held[odd[0]]))
        raise fault(where, found, "0 or 1", "write 1 for a row that no fit may see")
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

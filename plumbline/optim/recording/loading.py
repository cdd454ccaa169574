"""A recording folder on disk: ``dataset.toml``, ``samples.csv`` and, where needed, a URDF.

``load_recording("bench-2")`` reads, never writes, runs nothing that it reads, and either returns a
:class:`~plumbline.optim.recording.recording.Recording` or raises a one-line
:class:`~plumbline.errors.PlumblineError`.
"""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError, best_matches, fault, listed, one_line, shown
from plumbline.kinematics.constants import LARGEST_FILE, LARGEST_URDF
from plumbline.kinematics.files import is_file, is_folder, read_file, reason
from plumbline.kinematics.robot import Robot, refuse_xacro
from plumbline.optim.recording.building import build, chain_to, check_observation
from plumbline.optim.recording.columns import (
    as_counted,
    context_columns,
    counted_otherwise,
    coupled,
    elsewhere_columns,
    joint_columns,
    known_columns,
    measured_columns,
    numbered,
    with_mimics,
)
from plumbline.optim.recording.constants import LARGEST_SETTINGS, LARGEST_TWIST
from plumbline.optim.recording.kinds import ALWAYS, ELSEWHERE, KINDS
from plumbline.optim.recording.recording import Recording, hash_of
from plumbline.optim.recording.settings import Section, by_joint, read_settings, torque_constants
from plumbline.optim.recording.table import Array, Origin, Table, decode, read_table
from plumbline.optim.recording.urdf import check_urdf

SETTINGS, SAMPLES = "dataset.toml", "samples.csv"
LARGEST = {SETTINGS: LARGEST_SETTINGS, SAMPLES: LARGEST_FILE}
CHECKED = (  # settings that are checked against the samples, with their sections
    ("", "noise_std"), ("", "noise_std_rotation"), ("", "robot"), ("robot", "gravity"),
    ("tool", "offset"), ("fit", "always"), ("sockets", "distance"), ("sockets", "pairs"),
    ("motion", "command"),
)  # fmt: skip
SOURCES_OF_ROBOT = ("urdf", "mjcf", "bundled", "description", "dh")
TABLES = {
    "robot": (*SOURCES_OF_ROBOT, "tip_frame", "gravity", "name", "couplings"),
    "tool": ("offset",),
    "sockets": ("distance", "pairs"),
    "fit": ("always",),
    "motion": ("effort_unit", "torque_constant", "noise_std"),
}
# Where it came from is the reader's business: kept in the file, hashed, not used here.
PROVENANCE = (
    "description", "instrument", "source", "licence", "license", "citation", "sha256", "gears",
)  # fmt: skip
KEYS = ("name", "observation", "noise_std", "noise_std_rotation", "measured_joints")


@dataclass(frozen=True)
class RobotFiles:
    """The robot of a folder, the tip frame to use, and the bytes it was made from."""

    robot: Robot
    tip_frame: str | None
    data: bytes


@dataclass(frozen=True, eq=False)
class Folder:
    """A recording's folder whose settings are read, and whose samples are read when asked for."""

    place: Path  # where it is
    settings: Section  # what ``dataset.toml`` says
    data: bytes  # its bytes

    @cached_property
    def _samples(self) -> bytes:
        return read_bytes(self.place, SAMPLES)

    @cached_property
    def table(self) -> Table:
        """The rows of ``samples.csv``."""
        return read_table(SAMPLES, self._samples)

    @property
    def origin(self) -> Origin:
        """Where its rows stand, and the settings that are checked against them."""
        places: dict[str, str] = {}
        for title, key in CHECKED:
            section = self.settings.section(title) if title else self.settings
            label = f"[{title}] {key}" if title else f"[{key}]" if key == "robot" else key
            places[label] = section.where(key)
        return replace(self.table.origin, keys=places)

    @property
    def name(self) -> str:
        """What it is called, or else the folder, in characters that can be shown anywhere."""
        try:
            name = self.settings.word("name") or self.place.resolve().name
        except (OSError, RuntimeError):
            name = self.place.name
        return one_line(name) or "recording"

    def sha256(self, *more: bytes) -> str:
        """Hash of both files, and of what else was read."""
        return hash_of(self.data, self._samples, *more)

    def must_be(self, observation: str, lacking: str) -> None:
        """Refuse another kind of observation than this one, and say which command reads it."""
        kind, where = self.settings.word("observation"), self.settings.where("observation")
        if kind == observation:
            return
        if kind is None:
            raise fault(where, "nothing", observation, f'write observation = "{observation}"')
        if kind in KINDS or kind in ELSEWHERE:
            command = ELSEWHERE[kind].command if kind in ELSEWHERE else "plumbline diagnose FOLDER"
            raise fault(where, f"{kind}, which has no {lacking}", observation, f"run: {command}")
        near = best_matches(kind, [observation, *KINDS, *ELSEWHERE])
        raise fault(where, shown(kind), observation, f"best matches: {near}")


def open_folder(folder: str | Path) -> Folder:
    """Read the settings of a recording's folder of any kind, refused if there are none."""
    place = Path(folder)
    if not is_folder(place):
        if is_file(place):
            mend = "give the folder that holds dataset.toml; plumbline import makes it of a log"
            raise fault(str(folder), "a file", "a recording's folder", mend)
        raise fault(str(folder), "no such folder", "a recording", "check the path")
    data = read_bytes(place, SETTINGS)
    return Folder(place, read_settings(SETTINGS, data), data)


def load_recording(
    folder: str | Path,
    *,
    known_effects: Iterable[str] | None = None,
    made: RobotFiles | None = None,
) -> Recording:
    """Read and check a recording folder, which is never written to.

    ``[fit] always`` may hold ``frame``, ``tool`` and known effects, those of the library if not
    given; the robot is made of the folder's own settings unless it is given.

    Raises:
        PlumblineError: The folder cannot be used; one line says where, why and how to mend it.
    """
    opened = open_folder(folder)
    place, settings = opened.place, opened.settings
    observation = _observation(settings, place)
    given = _given(settings)
    made = made or read_robot(settings, place)
    table = opened.table
    where, columns = settings.section("robot").where("tip_frame"), numbered(table.columns, "q")
    chain = chain_to(made.robot, made.tip_frame, where, observation, max(columns, default=None))
    table = with_mimics(table, made.robot, chain)
    joints = joint_columns(table, made.robot, chain)
    known, called = known_columns(joints, observation), as_counted(table, joints)
    measured, measured_joints = measured_columns(table, observation, joints, settings)
    context = context_columns(table, joints, observation)
    if "velocity" in context:
        context["velocity"] = coupled(context["velocity"], joints.numbers, settings)
    return build(
        replace(opened.origin, columns=called),
        name=opened.name,
        observation=observation,
        robot=made.robot,
        tip_frame=made.tip_frame,
        q=coupled(table.block(joints.names), joints.numbers, settings),
        measured=measured,
        measured_joints=measured_joints,
        sha256=opened.sha256(made.data),
        notes=(
            *_unused(settings),
            *table.notes,
            *table.unused(known),
            *counted_otherwise(called),
        ),
        known_effects=known_effects,
        noise_by_joint=_noise_by_joint(settings, observation, chain.n, context),
        **given,
        **context,
    )


def read_bytes(folder: Path, name: str, largest: int | None = None) -> bytes:
    """A regular file of a recording (PlumblineError), of a size [byte] by its name or as given."""
    try:
        return read_file(folder / name, largest or LARGEST.get(name, LARGEST_FILE))
    except FileNotFoundError:
        found = f"no such file in {folder.name} (there: {_there(folder)})"
        file = listed([name])
        mend = "add it or mend its name"
        if name == "dataset.toml" and is_file(folder / "session.toml"):
            mend = "it is a session of several: name the folder of one of them"
        raise fault(file, found, f"a file {file}", mend) from None
    except (OSError, ValueError) as error:
        found = f"a file that cannot be read ({reason(error)})"
        raise fault(listed([name]), found, "a plain readable file", "mend it") from None


def _there(folder: Path) -> str:
    try:
        return listed(sorted(os.listdir(folder))) or "nothing"
    except OSError as error:
        return reason(error)


def _observation(settings: Section, place: Path) -> str:
    """The kind of observation; one that another command reads is checked for its columns first."""
    name = settings.word("observation")
    where = settings.where("observation")
    if name is None:
        expected = f"one of {', '.join(KINDS)}"
        raise fault(where, "nothing", expected, 'write observation = "tip_position"')
    if name in ELSEWHERE:
        elsewhere_columns(read_table(SAMPLES, read_bytes(place, SAMPLES)), name)
    check_observation(name, where)
    return name


def _given(settings: Section) -> dict[str, Any]:
    """Arguments of a recording that are in its settings."""
    fit, tool, sockets = (settings.section(key) for key in ("fit", "tool", "sockets"))
    named = isinstance(settings.values.get("instrument"), str)  # its name, or a table about it
    instrument = settings.section("no" if named else "instrument")
    always = fit.words("always")
    offset = tool.vector("offset")
    return {
        **_noise(settings),
        "scale_std": instrument.number("scale_std"),
        "noise_std_rotation": settings.number("noise_std_rotation"),
        "always": ALWAYS if always is None else always,
        "tool_offset": (0.0, 0.0, 0.0) if offset is None else offset,
        "socket_distance": sockets.number("distance"),
        "socket_pairs": _pairs(sockets),
    }


def _noise(settings: Section) -> dict[str, Any]:
    """One number for all axes, or a list of one for each."""
    value = settings.values.get("noise_std")
    if not isinstance(value, list):
        return {"noise_std": settings.number("noise_std")}
    if not all(isinstance(v, float | int) and not isinstance(v, bool) for v in value):
        raise settings.fault("noise_std", "numbers", "write noise_std = [1e-4, 1e-4, 2e-4]")
    return {"noise_axes": value}


def _noise_by_joint(
    settings: Section, observation: str, joints: int, context: Mapping[str, Array]
) -> Array | None:
    """Noise (n,) [N m or N] of efforts, stated in the unit that they were recorded in."""
    motion = settings.section("motion")
    stated = motion if "noise_std" in motion.values else settings
    if observation != "joint_torque":
        return None
    if "noise_std" in stated.values:
        own = by_joint(stated, "noise_std", joints)
    elif "noise_rows" in context:
        own = np.full(joints, np.sqrt(np.mean(context["noise_rows"] ** 2)))
    else:
        return None
    return own * torque_constants(settings, joints)


def _pairs(sockets: Section) -> tuple[tuple[int, int], ...]:
    value = sockets.values.get("pairs", [])
    if not isinstance(value, list) or not all(_is_pair(pair) for pair in value):
        raise sockets.fault("pairs", "pairs of sockets", "write pairs = [[0, 1], [2, 3]]")
    return tuple((a, b) for a, b in value)


def _is_pair(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(type(k) is int for k in value)


def _unused(settings: Section) -> tuple[str, ...]:
    """Notes on keys that nothing reads, and on what was left to its default."""
    notes = list(settings.unused((*KEYS, *PROVENANCE, *TABLES)))
    for title, keys in TABLES.items():
        notes += settings.section(title).unused(keys)
    torques = settings.word("observation") == "joint_torque"
    if not torques and settings.section("tool").vector("offset") is None:
        notes.append(f"{SETTINGS}: no [tool] offset, taken as [0, 0, 0]")
    return tuple(notes)


def read_robot(settings: Section, folder: Path) -> RobotFiles:
    """The robot named in ``[robot]``, mounted as its gravity says (PlumblineError: none)."""
    section = settings.section("robot")
    given = [key for key in SOURCES_OF_ROBOT if key in section.values]
    if len(given) != 1:
        found = " and ".join(given) or ("no robot" if section.values else "no [robot]")
        mend = 'write [robot] and urdf = "robot.urdf" or bundled = "ur5"'
        where = section.where(given[1]) if given else SETTINGS
        raise fault(where, found, "one of urdf, mjcf, bundled, description or [[robot.dh]]", mend)
    tip_frame = section.word("tip_frame")
    try:
        robot, data = _made(section, folder, given[0], tip_frame)
    except PlumblineError as error:
        if error.file == SETTINGS:  # it says where it stands
            raise
        raise PlumblineError(one_line(f"{section.where(given[0])}: {error}")) from None
    gravity = section.vector("gravity")
    return RobotFiles(robot if gravity is None else robot.with_gravity(gravity), tip_frame, data)


def _made(section: Section, folder: Path, source: str, tip: str | None) -> tuple[Robot, bytes]:
    """A robot by one of its sources, and the bytes that it was made from."""
    if source == "dh":
        return _from_dh(section, tip), b""
    if source in ("urdf", "mjcf"):
        return _from_file(section, folder, source)
    name = section.word(source) or ""
    if source == "bundled":
        return Robot.bundled(name), name.encode()
    robot = Robot.described(name)
    return robot, (robot.urdf or "").encode()


def _from_dh(section: Section, tip_frame: str | None) -> Robot:
    rows = section.values["dh"]
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        mend = "write a table [[robot.dh]] for each joint, with d, a, alpha, theta, kind"
        raise section.fault("dh", "rows of a DH table", mend)
    for number, row in enumerate(rows, start=1):
        for key in ("alpha", "theta"):
            value = row.get(key, 0.0)
            if isinstance(value, int | float) and abs(value) > LARGEST_TWIST:
                found = f"{key} = {shown(value)} in row {number}"
                mend = "looks like degrees: use rad"
                raise fault(section.where("dh"), found, "an angle within one turn", mend)
    # Rows have no names: the last one's frame is called as the folder calls its tip.
    inner = tip_frame in {f"link{k}" for k in range(1, 1000)}
    name = section.word("name") or "dh"
    return Robot.from_dh(rows, name=name, tip_frame="flange" if inner else tip_frame or "flange")


def _from_file(section: Section, folder: Path, source: str) -> tuple[Robot, bytes]:
    """Of the bytes that were checked and are hashed, not of a file that may change meanwhile."""
    file, data = _inside(section, folder, source)
    text = decode(file, data)
    if source == "urdf":
        refuse_xacro(text, file)
        check_urdf(file, data)
    try:
        return (Robot.from_urdf if source == "urdf" else Robot.from_mjcf)(text), data
    except PlumblineError as error:
        raise PlumblineError(f"{file}: {error}") from None


def _inside(section: Section, folder: Path, key: str) -> tuple[str, bytes]:
    """The name and the bytes of a robot's file, which must lie inside of the folder."""
    name = section.word(key) or ""
    path = Path(name)
    inside = not path.is_absolute() and ".." not in path.parts and "\\" not in name
    if not inside or not name.isprintable() or not _stays_inside(folder, path):
        what = key.upper()
        raise section.fault(key, "a path inside the folder", f"copy the {what} into the folder")
    return listed([name]), read_bytes(folder, name, LARGEST_URDF)


def _stays_inside(folder: Path, path: Path) -> bool:
    """Whether links, too, lead to a place inside of the folder."""
    try:
        return (folder / path).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):
        return False

"""A session on disk: a folder of recordings' folders with ``session.toml``.

.. code-block:: toml

    name = "arm 7"
    recordings = ["tracker", "encoders"]   # folders beside this file
    shared = ["tool"]                      # of frame, tool, sockets; each one's own unless named

    [robot]                                # for recordings that name none themselves
    bundled = "ur5"
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

from plumbline.errors import best_matches, fault, shown
from plumbline.kinematics.files import is_file, is_folder
from plumbline.optim.core.quantities import counted
from plumbline.optim.recording.loading import (
    SOURCES_OF_ROBOT,
    RobotFiles,
    open_folder,
    read_bytes,
    read_robot,
)
from plumbline.optim.recording.session import SHARED
from plumbline.optim.recording.settings import Section, read_settings

FILE = "session.toml"
KEYS = ("name", "recordings", "shared", "robot")
ROBOT = (*SOURCES_OF_ROBOT, "tip_frame", "gravity", "name")


def is_session(folder: str | Path) -> bool:
    """Whether a folder holds a session of several recordings."""
    place = Path(folder)
    return is_folder(place) and is_file(place / FILE)


@dataclass(frozen=True, eq=False)
class SessionFile:
    """What a ``session.toml`` says."""

    name: str  # what the recordings are called together
    place: Path  # the folder
    recordings: tuple[str, ...]  # names of folders in it
    shared: tuple[str, ...]  # of :data:`SHARED`
    robot: RobotFiles | None  # for recordings that name none themselves, if any


def open_session(folder: str | Path) -> SessionFile:
    """Read and check a ``session.toml``; nothing is written.

    Raises:
        PlumblineError: It cannot be used; one line says where, why and how to mend it.
    """
    place = Path(folder)
    settings = read_settings(FILE, read_bytes(place, FILE))
    _refuse_unknown(settings, KEYS)
    _refuse_unknown(settings.section("robot"), ROBOT)
    names = settings.words("recordings") or ()
    if not names:
        raise fault(
            settings.where("recordings"), "nothing", "folders", 'write recordings = ["a", "b"]'
        )
    name, times = Counter(names).most_common(1)[0]
    if times > 1:  # told before any is read
        where, found = settings.where("recordings"), f"{shown(name)} {counted(times, 'time')}"
        raise fault(where, found, "each once", "leave the others out")
    shared = settings.words("shared") or ()
    for word in shared:
        if word not in SHARED:
            raise settings.fault("shared", f"of {', '.join(SHARED)}", "leave the others out")
    robot = read_robot(settings, place) if "robot" in settings.values else None
    for name in names:
        _refuse_absent(settings, place, name)
    called = settings.word("name") or place.resolve().name
    return SessionFile(called, place, names, shared, robot)


def robot_of_part(folder: Path, robot: RobotFiles | None) -> RobotFiles | None:
    """The session's robot as a recording has it; None where that names one itself."""
    own = open_folder(folder).settings.section("robot")
    if robot is None or any(key in own.values for key in SOURCES_OF_ROBOT):
        return None
    made = replace(robot, tip_frame=own.word("tip_frame") or robot.tip_frame)
    gravity = own.vector("gravity")
    if gravity is None:
        return made
    return replace(made, robot=made.robot.with_gravity(gravity))


def _refuse_absent(settings: Section, place: Path, name: str) -> None:
    """Refuse a recording that is no folder beside the session's file."""
    path = Path(name)
    inside = not path.is_absolute() and ".." not in path.parts and name.isprintable()
    if inside and is_folder(place / path):
        return
    there = sorted(p.parent.name for p in place.glob("*/dataset.toml"))
    found, near = f"{shown(name)}, no folder in {place.name}", best_matches(name, there)
    where = settings.where("recordings")
    raise fault(where, found, "folders beside it", f"best matches: {near or 'none'}")


def _refuse_unknown(section: Section, known: tuple[str, ...]) -> None:
    """Refuse a key that nothing reads: what is meant to be shared must not be left unshared."""
    for key in section.values:
        if key not in known:
            mend = f"best matches: {best_matches(key, known)}"
            raise fault(section.where(key), f"the key {shown(key)}", f"{', '.join(known)}", mend)

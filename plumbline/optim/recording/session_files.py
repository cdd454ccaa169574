"""A session on disk: a folder of recordings' folders with ``session.toml``.

.. code-block:: toml

    name = "arm 7"
    recordings = ["tracker", "encoders"]   # folders beside this file
    shared = ["tool"]                      # of frame, tool, sockets; each one's own unless named

    [robot]                                # for recordings that name none themselves
    bundled = "ur5"
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from plumbline.errors import PlumblineError, best_matches, fault, shown
from plumbline.kinematics.files import is_file, is_folder
from plumbline.optim.recording.kinds import ELSEWHERE, KINDS
from plumbline.optim.recording.loading import (
    SOURCES_OF_ROBOT,
    RobotFiles,
    load_recording,
    open_folder,
    read_bytes,
    read_robot,
)
from plumbline.optim.recording.recording import Recording, Session
from plumbline.optim.recording.session import SHARED, TOGETHER, build_session
from plumbline.optim.recording.settings import Section, read_settings

FILE = "session.toml"
KEYS = ("name", "recordings", "shared", "robot")
ROBOT = (*SOURCES_OF_ROBOT, "tip_frame", "gravity", "name")


def is_session(folder: str | Path) -> bool:
    """Whether a folder holds a session of several recordings."""
    place = Path(folder)
    return is_folder(place) and is_file(place / FILE)


def load_session(folder: str | Path, *, known_effects: Iterable[str] | None = None) -> Session:
    """Read and check a session's folder and all of its recordings; nothing is written.

    Args:
        folder: The folder with ``session.toml``.
        known_effects: As for :func:`~plumbline.optim.recording.loading.load_recording`.

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
    shared = settings.words("shared") or ()
    for word in shared:
        if word not in SHARED:
            raise settings.fault("shared", f"of {', '.join(SHARED)}", "leave the others out")
    robot = read_robot(settings, place) if "robot" in settings.values else None
    effects = None if known_effects is None else tuple(known_effects)
    for name in names:
        _refuse_absent(settings, place, name)
    found = [_recording(place, name, robot, effects) for name in names]
    return build_session(found, settings.word("name") or place.resolve().name, shared)


def _recording(
    place: Path,
    name: str,
    robot: RobotFiles | None,
    known_effects: tuple[str, ...] | None,
) -> Recording:
    """One of its recordings, with the session's robot if it names none itself."""
    try:
        return _read(place / name, robot, known_effects)
    except PlumblineError as error:
        raise error.inside(name) from None


def load_part(folder: str | Path) -> Recording:
    """Read and check one of several recordings that are given by their folders.

    Raises:
        PlumblineError: It cannot be used; the line names the folder.
    """
    return _recording(Path(), str(folder), None, None)


def _read(
    folder: Path, robot: RobotFiles | None, known_effects: tuple[str, ...] | None
) -> Recording:
    settings = open_folder(folder).settings
    kind, own = settings.word("observation"), settings.section("robot")
    if kind in {*KINDS, *ELSEWHERE} - {*TOGETHER}:
        where, mend = settings.where("observation"), "diagnose it on its own"
        raise fault(where, kind, f"one of {', '.join(TOGETHER)}", mend)
    if robot is None or any(key in own.values for key in SOURCES_OF_ROBOT):
        return load_recording(folder, known_effects=known_effects)
    made = replace(robot, tip_frame=own.word("tip_frame") or robot.tip_frame)
    gravity = own.vector("gravity")
    if gravity is not None:
        made = replace(made, robot=made.robot.with_gravity(gravity))
    return load_recording(folder, known_effects=known_effects, made=made)


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

"""Whatever is stored, by its path: a recording's folder of any kind, or an answer's JSON file."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from plumbline.errors import PlumblineError, best_matches, fault, shown
from plumbline.kinematics.files import is_file
from plumbline.optim.core.answer import Answer, kind_of
from plumbline.optim.hand_eye.recording import load_ranges
from plumbline.optim.hand_eye.to_diagnose import ranges_to_diagnose
from plumbline.optim.model import Drives, Model
from plumbline.optim.model.drives import is_drives
from plumbline.optim.recording import session
from plumbline.optim.recording.kinds import KINDS
from plumbline.optim.recording.loading import RobotFiles, load_recording, open_folder
from plumbline.optim.recording.recording import Recording
from plumbline.optim.registration.to_diagnose import fiducials_to_diagnose

# Who reads the kinds of observation that are no Recording, and who answers, loaded on demand.
READERS: Mapping[str, str] = {
    "plane_range": "hand_eye.recording:load_ranges",
    "surface_scan": "hand_eye.scan_recording:load_scan",
    "fiducials": "registration.to_diagnose:load_markers",
    "motion": "diagnosis.motion.recording:load_motion",
    "tracking": "diagnosis.motion.tracking:load_tracking",
}
METHODS = (
    "hand_eye.answer", "hand_eye.scan", "registration", "dh_fit", "pointing", "diagnosis.diagnose",
    "diagnosis.motion.answer", "diagnosis.several.sections", "budget",
)  # fmt: skip


def load(path: str | Path, *, known_effects: Iterable[str] | None = None) -> Any:
    """Read and check what is stored there; nothing is written, solved or run.

    Args:
        path: A recording's folder, read by its ``observation``: tips, poses, fixed points and
            joints as a :class:`~.recording.recording.Recording`, ``plane_range`` as a
            :class:`~.hand_eye.recording.RangeRecording`, ``surface_scan`` as a
            :class:`~.hand_eye.scan_recording.ScanRecording`, ``fiducials`` as
            :class:`~.registration.fiducials.Fiducials`, or, where a marker was touched again, as
            the Recording that ``diagnose`` takes, ``motion`` and ``tracking`` as
            :class:`~.diagnosis.motion.recording.MotionRecording`; a folder of such folders with
            ``session.toml`` as a :class:`~.recording.recording.Session`, or as a list where no
            one fit can hold them. Or the file that an answer's ``save`` wrote: that answer; or the
            TOML of a model or of drives.
        known_effects: Names that ``[fit] always`` of a Recording may hold besides ``frame`` and
            ``tool``; those of the library by default.

    Raises:
        PlumblineError: It cannot be used; one line says where, why and how to mend it.
    """
    if is_file(Path(path)):
        return load_model(path) if Path(path).suffix == ".toml" else _answer(path)
    if session.is_session(path):
        stated = session.open_session(path)
        parts = parts_of_session(stated, known_effects=known_effects)
        if all(isinstance(p, Recording) and p.observation in KINDS for p in parts):
            return session.build_session(parts, stated.name, stated.shared)
        return parts
    reader = READERS.get(open_folder(path).settings.word("observation") or "")
    if reader is None:
        return load_recording(path, known_effects=known_effects)
    module, _, function = reader.partition(":")
    return getattr(_module(module), function)(path)


def load_model(path: str | Path) -> Model | Drives:
    """What ``--model`` wrote: a model of an arm, or a robot's drives (PlumblineError: neither)."""
    return Drives.load(path) if is_drives(path) else Model.load(path)


def load_to_diagnose(path: str | Path) -> Recording:
    """A folder of rows that ``diagnose`` takes, ranges and fiducials too (PlumblineError)."""
    kind = open_folder(path).settings.word("observation")
    if kind == "plane_range":
        return ranges_to_diagnose(load_ranges(path))
    return fiducials_to_diagnose(path) if kind == "fiducials" else load_recording(path)


def load_part(
    folder: str | Path,
    *,
    name: str = "",
    robot: RobotFiles | None = None,
    known_effects: Iterable[str] | None = None,
) -> Any:
    """One of several recordings of any kind that ``diagnose`` takes, checked (PlumblineError).

    Errors call it by ``name``, or as the folder is given; ``robot`` is for one that names none.
    """
    place = Path(folder)
    try:
        kind, made = (
            open_folder(place).settings.word("observation"),
            session.robot_of_part(place, robot),
        )
        if kind == "motion":
            return _module("diagnosis.motion.recording").load_motion(place, made)
        if kind in READERS:
            diagnosed = kind in ("plane_range", "fiducials")
            return load_to_diagnose(place) if diagnosed else load(place)
        return load_recording(place, known_effects=known_effects, made=made)
    except PlumblineError as error:
        raise error.inside(name or str(folder)) from None


def parts_of_session(
    stated: session.SessionFile, *, known_effects: Iterable[str] | None = None
) -> list[Any]:
    """The recordings of a session's folder, each with the session's robot if it names none."""
    effects = None if known_effects is None else tuple(known_effects)
    parts = [
        load_part(stated.place / name, name=name, robot=stated.robot, known_effects=effects)
        for name in stated.recordings
    ]
    return told_apart(parts, stated.recordings)


def told_apart(parts: Sequence[Any], folders: Sequence[str]) -> list[Any]:
    """Recordings from folders, those of one name with their folder's beside it."""
    names = [part.name for part in parts]
    return [
        replace(part, name=f"{part.name} ({folder})") if names.count(part.name) > 1 else part
        for part, folder in zip(parts, folders, strict=True)
    ]


def _answer(path: str | Path) -> Answer:
    """A stored answer; methods are imported until one of them knows its kind."""
    kind = kind_of(path)
    for method in METHODS:
        if kind in Answer.kinds:
            break
        _module(method)
    if kind not in Answer.kinds:
        near = best_matches(kind, Answer.kinds)
        raise fault(str(path), f"kind {shown(kind)}", "a kind of answer", f"best matches: {near}")
    return Answer.kinds[kind].load(path)


def _module(name: str) -> Any:
    return import_module(f"plumbline.optim.{name}")

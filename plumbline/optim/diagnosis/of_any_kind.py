"""Ask a recording of any kind that is diagnosed, or several: each goes to the engine it needs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

from plumbline.errors import PlumblineError, fault
from plumbline.optim.core.progress import Progress
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.diagnose import diagnose as diagnose_rows
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.diagnose import diagnose_motion
from plumbline.optim.diagnosis.motion.recording import OBSERVATION, TRACKING, MotionRecording
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.several.motions import diagnose_session
from plumbline.optim.diagnosis.several.sections import Sections, diagnose_all
from plumbline.optim.hand_eye.recording import RangeRecording
from plumbline.optim.hand_eye.to_diagnose import ranges_to_diagnose
from plumbline.optim.loading import load_part, parts_of_session, told_apart
from plumbline.optim.recording.loading import open_folder
from plumbline.optim.recording.recording import Recording, Session
from plumbline.optim.recording.session import is_session, open_session
from plumbline.optim.registration.fiducials import Fiducials
from plumbline.optim.registration.to_diagnose import fiducials_to_diagnose

Rows = Recording | RangeRecording | Fiducials
Given = Rows | MotionRecording | str | Path


@overload
def diagnose(
    recording: MotionRecording,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> MotionDiagnosis: ...


@overload
def diagnose(
    recording: Rows | Session | Sequence[Recording],
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Diagnosis: ...


@overload
def diagnose(
    recording: str | Path | Sequence[Given],
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Diagnosis | MotionDiagnosis | Sections: ...


def diagnose(
    recording: Given | Session | Sequence[Given],
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Diagnosis | MotionDiagnosis | Sections:
    """Say where the gap of a recording lies, which effects cause it and how far it shrinks.

    Args:
        recording: What was recorded, or the folder of it: rows, ranges, fiducials, or
            a motion. Of several of one robot, a list, or the folder of a session: one
            verdict, with what all of them share fitted to all, and each one's own frame, tool
            and noise; kinds that no one fit can hold (places, efforts, motions, ranges, fiducials)
            are its sections.
        options: How; see :class:`~plumbline.optim.diagnosis.options.DiagnosisOptions`.
        progress: Called with what is being done and the share done.

    Raises:
        PlumblineError: The folder cannot be used, or another simple set-up explains the rows far
            better: a joint's sign or zero, swapped columns, mirrored axes, another robot; or what
            is held out needs a column that is not there; or recordings are not of one robot.
    """
    if isinstance(recording, RangeRecording | Fiducials):
        recording = _read(recording)
    if isinstance(recording, MotionRecording):
        return diagnose_drives(recording, options, progress=progress)
    if isinstance(recording, Recording):
        return diagnose_rows(recording, options, progress=progress)
    if isinstance(recording, Session):
        return diagnose_session(recording, options, progress=progress)
    if isinstance(recording, str | Path):
        if is_session(recording):
            return diagnose_several(recording, options, progress=progress)
        if is_motion(recording):
            return diagnose_drives(recording, options, progress=progress)
        return diagnose_rows(recording, options, progress=progress)
    return diagnose_several(recording, options, progress=progress)


def diagnose_several(
    recordings: Sequence[Given] | str | Path,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Diagnosis | MotionDiagnosis | Sections:
    """The diagnosis of several recordings of a robot, of a list or of a session's folder.

    Raises:
        PlumblineError: One cannot be used, or they are not of one robot.
    """
    said: dict[str, Any] = {}
    if isinstance(recordings, str | Path):
        stated = open_session(recordings)
        parts = parts_of_session(stated)
        said = {"name": stated.name, "shared": stated.shared}
    else:
        parts = [_read(one) for one in recordings]
        if all(isinstance(one, str | Path) for one in recordings):
            parts = told_apart(parts, [str(one) for one in recordings])
    _refuse_folds_of_motions(parts, options or DiagnosisOptions())
    return diagnose_all(parts, options, progress=progress, **said)


def _read(one: Given) -> Recording | MotionRecording:
    """A recording as it is diagnosed.

    Raises:
        PlumblineError: It cannot be read.
    """
    if isinstance(one, RangeRecording):
        return ranges_to_diagnose(one)
    if isinstance(one, Fiducials):
        return fiducials_to_diagnose(one)
    if not isinstance(one, str | Path):
        return one
    if is_session(one):
        expected = "recordings, or one session alone"
        raise fault(str(one), "a session", expected, "name its folders one by one")
    found: Recording | MotionRecording = load_part(one)
    return found


def is_motion(folder: str | Path) -> bool:
    """Whether a folder holds commands and what the joints, or a tip, did."""
    return open_folder(folder).settings.word("observation") in (OBSERVATION, TRACKING)


def diagnose_drives(
    recording: MotionRecording | str | Path,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> MotionDiagnosis:
    """The diagnosis of a motion, asked for as any other is.

    Raises:
        PlumblineError: The recording cannot be used, or is to be held out by its rows or places.
    """
    options = options or DiagnosisOptions()
    _refuse_folds_of_motions([recording], options)
    return diagnose_motion(recording, options, progress=progress)


def _refuse_folds_of_motions(recordings: Sequence[object], options: DiagnosisOptions) -> None:
    """Refuse to leave single samples of a motion out.

    Raises:
        PlumblineError: It says why.
    """
    rows = all(isinstance(one, Recording) for one in recordings)
    if options.held_out in ("rows", "workspace") and not rows:
        raise PlumblineError(
            f"held_out {options.held_out!r}: samples of one motion foretell each other; auto, "
            "groups or time expected"
        )

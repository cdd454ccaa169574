"""Ask a recording of any kind that is diagnosed: each goes to the engine that its rows need."""

from __future__ import annotations

from pathlib import Path
from typing import overload

from plumbline.errors import PlumblineError
from plumbline.optim.core.progress import Progress
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.diagnose import diagnose as diagnose_rows
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.diagnose import diagnose_motion
from plumbline.optim.diagnosis.motion.recording import OBSERVATION, TRACKING, MotionRecording
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.recording.loading import open_folder
from plumbline.optim.recording.recording import Recording


@overload
def diagnose(
    recording: MotionRecording,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> MotionDiagnosis: ...


@overload
def diagnose(
    recording: Recording,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Diagnosis: ...


@overload
def diagnose(
    recording: str | Path,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Diagnosis | MotionDiagnosis: ...


def diagnose(
    recording: Recording | MotionRecording | str | Path,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Diagnosis | MotionDiagnosis:
    """Say where the gap of a recording lies, which effects cause it and how far it shrinks.

    Args:
        recording: What was recorded, or the folder of it: rows, or a motion.
        options: How; see :class:`~plumbline.optim.diagnosis.options.DiagnosisOptions`.
        progress: Called with what is being done and the share done.

    Raises:
        PlumblineError: The folder cannot be used, or another simple set-up explains the rows far
            better: a joint's sign or zero, swapped columns, mirrored axes, another robot; or what
            is held out needs a column that is not there.
    """
    if isinstance(recording, MotionRecording):
        return diagnose_drives(recording, options, progress=progress)
    if isinstance(recording, Recording) or not is_motion(recording):
        return diagnose_rows(recording, options, progress=progress)
    return diagnose_drives(recording, options, progress=progress)


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
    if options.held_out in ("rows", "workspace"):
        raise PlumblineError(
            f"held_out {options.held_out!r}: samples of one motion foretell each other; auto, "
            "groups or time expected"
        )
    return diagnose_motion(recording, options, progress=progress)

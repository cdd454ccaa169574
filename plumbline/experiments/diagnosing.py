"""Diagnose a recording by its folder's name, in one line of a notebook."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from plumbline.optim.diagnosis.diagnose import diagnose as diagnose_recording
from plumbline.optim.loading import load_recording
from plumbline.optim.recording import Recording

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.diagnose import Diagnosis


def diagnose(recording: Recording | str | Path, **options: Any) -> Diagnosis:
    """Where the gap lies, which effects cause it, how far it shrinks.

    Args:
        recording: A recording, or the folder of one.
        **options: As of :func:`plumbline.optim.diagnosis.diagnose.diagnose`.

    Raises:
        RecordingError: The folder cannot be used; one line says why and how to mend it.
    """
    if not isinstance(recording, Recording):
        recording = load_recording(recording)
    return diagnose_recording(recording, **options)

"""Who runs what, on which data: recordings, commands, simulators and reports.

``from plumbline.experiments import diagnose, load_recording, fetch`` is all that a notebook needs.
They are loaded on first use, so that a command that needs none of them starts at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plumbline.experiments.diagnosing import diagnose
    from plumbline.experiments.report.html import write_report
    from plumbline.experiments.sources import fetch, list_sources
    from plumbline.optim.diagnosis.rehearsal import rehearse
    from plumbline.optim.loading import load_recording
    from plumbline.optim.recording import Recording

__all__ = [
    "Recording", "diagnose", "fetch", "list_sources", "load_recording", "rehearse", "write_report",
]  # fmt: skip

_HOME = {
    "Recording": "plumbline.optim.recording",
    "diagnose": "plumbline.experiments.diagnosing",
    "fetch": "plumbline.experiments.sources",
    "list_sources": "plumbline.experiments.sources",
    "load_recording": "plumbline.optim.loading",
    "rehearse": "plumbline.optim.diagnosis.rehearsal",
    "write_report": "plumbline.experiments.report.html",
}


def __getattr__(name: str) -> Any:
    """Load what is asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """What there is, loaded or not."""
    return sorted([*globals(), *__all__])

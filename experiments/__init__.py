"""Who runs what, on which data: recordings, commands, simulators and reports.

``from experiments import diagnose, load_recording, fetch`` is all that a notebook needs. They are
loaded on first use, so that a command that needs none of them starts at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from experiments.diagnosing import diagnose
    from experiments.report.html import write_report
    from experiments.sources import fetch, list_sources
    from optim.diagnosis.rehearsal import rehearse
    from optim.loading import load_recording
    from optim.recording import Recording

__all__ = [
    "Recording", "diagnose", "fetch", "list_sources", "load_recording", "rehearse", "write_report",
]  # fmt: skip

_HOME = {
    "Recording": "optim.recording",
    "diagnose": "experiments.diagnosing",
    "fetch": "experiments.sources",
    "list_sources": "experiments.sources",
    "load_recording": "optim.loading",
    "rehearse": "optim.diagnosis.rehearsal",
    "write_report": "experiments.report.html",
}


def __getattr__(name: str) -> Any:
    """Load what is asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """What there is, loaded or not."""
    return sorted([*globals(), *__all__])

"""Several recordings or joints under one verdict: what each leaves, what carries over: tables."""

import math
from collections.abc import Sequence

from plumbline.experiments.report.page.page import Grid
from plumbline.optim.core.quantities import measured, quantity, significant
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.of_recordings import Carries, Compared, Transfer

LISTED = 40  # rows that are named one by one
JOINTS = "Root mean squares of what was left out of the fit."
RECORDINGS = (
    "Root mean squares of rows that were left out of the fit; then the same with causes that the "
    "other recordings alone have told."
)
TRANSFER = (
    "Each cause as one recording alone says it, and as all others say it together; z is their "
    "difference in standard errors of both."
)


def recordings(verdict: Verdict) -> Grid:
    """What each recording leaves, on rows that were left out."""
    columns = (
        "recording", "kind", "rows", "before", "after", "causes of the others alone", "noise",
        "gross rows",
    )  # fmt: skip
    rows = [
        (
            r.name,
            r.observation.replace("_", " "),
            f"{r.rows}",
            quantity(r.before, r.unit),
            quantity(r.after, r.unit),
            quantity(r.without_it, r.unit),
            f"{quantity(r.noise, r.unit)} ({r.noise_source})",
            _rows(r.gross),
        )
        for r in verdict.recordings
    ]
    return Grid(columns, rows, range(2, 7), sorts=False)


def joints(verdict: Verdict) -> Grid:
    """What each joint is missed by, on rows that were left out."""
    rows = [
        (joint.label, quantity(joint.before, joint.unit), quantity(joint.after, joint.unit))
        for joint in verdict.joints
    ]
    return Grid(("joint", "before", "after"), rows, (1, 2), sorts=False)


def _rows(gross: Sequence[int]) -> str:
    more = f" and {len(gross) - LISTED} more" if len(gross) > LISTED else ""
    return ", ".join(map(str, gross[:LISTED])) + more or "none"


def transfer(verdict: Verdict) -> Grid:
    """What one recording alone says of each cause, beside what all others say."""
    columns = ("cause", "recording", "carries over?", "z", "parameter", "here alone", "the others")
    rows = [line for t in verdict.transfer for line in _of_transfer(t)]
    return Grid(columns, rows, (3, 5, 6), sorts=False)


def _of_transfer(t: Transfer) -> list[tuple[str, ...]]:
    said = (t.label.replace("_", " "), t.recording, t.carries.value, _z(t))
    blank = ("",) * len(said)
    return [
        (*(blank if n else said), name, *_both(t, one))
        for n, (name, one) in enumerate(t.parameters.items())
    ]


def _z(t: Transfer) -> str:
    return significant(t.z, 2) if math.isfinite(t.z) else ""


def _both(t: Transfer, one: Compared) -> tuple[str, str]:
    others = "" if t.carries == Carries.ONLY else _told(one.others, one.others_std, one.unit)
    return _told(one.value, one.std, one.unit), others


def _told(value: float, std: float, unit: str) -> str:
    return measured(value, std, unit) if math.isfinite(std) else "not told"

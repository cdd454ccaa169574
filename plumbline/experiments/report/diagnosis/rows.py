"""Tables of a diagnosis's report: the rows that are missed most, what is always fitted."""

from collections.abc import Callable

import numpy as np

from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.experiments.report.page.page import Grid
from plumbline.optim.core.quantities import significant
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.verdict.words import estimate_words
from plumbline.optim.recording.session import named_row

SHOWN = 12  # rows: what fits on a page beside the rest


def worst_rows(subject: Subject) -> Grid:
    """The rows of which most is left after the causes, largest first."""
    recording, (before, after) = subject.recording, subject.sizes
    named, cells_of = _places(subject)
    columns = ["row", f"after [{subject.unit}]", f"before [{subject.unit}]", *named]
    columns += ["group"] if recording.group is not None else []
    columns += ["time [s]"] if recording.time is not None else []
    rows = []
    for k in np.argsort(-np.nan_to_num(after), kind="stable")[:SHOWN]:
        row = named_row(recording, subject.rows[k])
        cells = [row, significant(after[k]), significant(before[k])]
        cells += cells_of(int(k))
        cells += [] if recording.group is None else [str(recording.group[k])]
        cells += [] if recording.time is None else [f"{recording.time[k]:.4g}"]
        rows.append(cells)
    return Grid(columns, rows, range(len(columns)))


def _places(subject: Subject) -> tuple[list[str], Callable[[int], list[str]]]:
    """Columns that say where a row was taken, and a row's cells of them."""
    recording = subject.recording
    kinds, q, part = recording.chain.kinds, recording.q, recording.element
    joints = [f"q{j + 1} [{'deg' if kind == 'revolute' else 'mm'}]" for j, kind in enumerate(kinds)]
    factors = [np.rad2deg(1.0) if kind == "revolute" else 1e3 for kind in kinds]
    if subject.touches:
        joints = [f"ct {c} [mm]" for c in "xyz"]
    elif recording.stand_in:
        joints, factors = [], []
    own = [] if part is None else ["marker" if subject.touches else "plane"]
    own += ["range [mm]"] if subject.ranges else []

    def cells(k: int) -> list[str]:
        found = [] if part is None else [recording.elements[part[k] - 1]]
        found += [f"{1e3 * recording.measured[k, 0]:.2f}"] if subject.ranges else []
        values = zip(q[k, : len(factors)], factors, strict=True)
        return [*found, *(f"{v * f:.2f}" for v, f in values)]

    return [*own, *joints], cells


def nuisances(verdict: Verdict) -> Grid:
    """Frame, tool and what else was always fitted, each with its standard error."""
    found = verdict.nuisances.items()
    rows = [(name, estimate_words(e), e.doc) for name, e in found]
    return Grid(("parameter", "value ± standard error", "meaning"), rows, (1,), sorts=False)

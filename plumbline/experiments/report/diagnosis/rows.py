"""Tables of a diagnosis's report: the rows that are missed most, what is always fitted, ranks.

Ranks are those of true values of simulated cases among what was stated of them, with their band.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy

from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.experiments.report.page.page import Grid, Picture
from plumbline.optim.core.quantities import significant
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.verdict.words import estimate_words
from plumbline.optim.recording.session import named_row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 12  # rows: what fits on a page beside the rest
BAND = (0.025, 0.975)  # of the count of a tenth if ranks are even: 95 %
WIDTH, HEIGHT = 5.2, 2.2  # [in]


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


def band(counts: Sequence[int]) -> tuple[int, int]:
    """Between which the count of one tenth lies in 95 % if all are alike likely."""
    low, high = (int(scipy.stats.binom.ppf(p, sum(counts), 1.0 / len(counts))) for p in BAND)
    return low, high


def picture(counts: Sequence[int]) -> Picture:
    """The counts as bars: even ones say that stated errors are right."""
    low, high = band(counts)
    outside = sum(not low <= count <= high for count in counts)
    return Picture.of("diagnosis.ranks", histogram(counts), outside=outside, all=len(counts))


def histogram(counts: Sequence[int]) -> Figure:
    """Bars of the tenths, with the 95 % band of even ones."""
    from plumbline.experiments.report.style import AFTER, FLOOR, calm, drawing, says

    low, high = band(counts)
    with drawing(WIDTH, HEIGHT) as (figure, axes):
        calm(axes)
        axes.axhspan(low, high, color=FLOOR, alpha=0.2, linewidth=0.0)
        bars = axes.bar(np.arange(len(counts)) + 0.5, counts, 0.86, color=AFTER)
        for k, (bar, count) in enumerate(zip(bars, counts, strict=True)):
            says(bar, f"{10 * k} to {10 * (k + 1)} %: {count}")
        axes.annotate(
            "95 % of even counts", (1.01, (low + high) / 2), xycoords=("axes fraction", "data"),
            va="center", color=FLOOR, fontsize=8.5, annotation_clip=False,
        )  # fmt: skip
        axes.set(xlim=(0, len(counts)), xlabel="tenth of what was stated", ylabel="true values")
    return figure

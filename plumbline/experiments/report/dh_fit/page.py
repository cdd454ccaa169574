"""A fit of links on a page: misfits before and after, what the readings tell, worst rows."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report.dh_fit.pictures import correlations
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture, Tile
from plumbline.experiments.report.style import (
    AFTER,
    BEFORE,
    MOST_VECTORS,
    calm,
    house_style,
    new_figure,
    numbered,
)
from plumbline.optim.dh_fit import DHFit, HeldOut, Misfit
from plumbline.optim.dh_fit.answer import FIRST_ROW, UNITS

MM = 1e3
SHOWN = 12  # worst rows


def page(fit: DHFit, unseen: HeldOut | None = None) -> Page:
    """The page of a fit.

    Args:
        fit: The fit.
        unseen: Misfits of rows that no fit has seen, if they were asked for.
    """
    good = not fit.remarks
    before, after = (fit.before, fit.after) if unseen is None else (unseen.before, unseen.after)
    on = "" if unseen is None else " on rows that the fit has not seen"
    return Page(
        name=fit.recording.name,
        verdict="Links fitted" if good else "Links fitted, with doubts",
        tone="explained" if good else "outside-library",
        lead=(
            f"The drawing's links miss by {MM * before.rms:.3g} mm, the fitted ones by "
            f"{MM * after.rms:.3g} mm{on}.",
        ),
        tiles=[
            Tile("before", f"{MM * before.rms:.3g} mm", "root mean square"),
            Tile("after", f"{MM * after.rms:.3g} mm", f"largest {MM * after.max:.3g} mm"),
            Tile("noise of one axis", f"{MM * fit.noise:.3g} mm", "by what the fit leaves"),
            Tile("readings", f"{len(fit.readings)}", f"{len(fit.gross_rows)} gross"),
            Tile("told", f"{len(fit.quantities)}", "quantities"),
        ],
        parts=(_misfits(fit, unseen), _picture(fit), _quantities(fit), _worst(fit), _frame(fit),
               *_untold(fit)),
        warnings=fit.remarks,
        sha256=fit.recording.sha256,
    )  # fmt: skip


def _misfits(fit: DHFit, unseen: HeldOut | None) -> Part:
    rows = [("nominal links", fit.before), ("fitted links", fit.after)]
    if unseen is not None:
        rows += [("nominal, rows not seen", unseen.before), ("fitted, rows not seen", unseen.after)]
    if fit.registered is not None:
        labels = ("nominal, registration points", "fitted, registration points")
        rows += list(zip(labels, fit.registered, strict=True))
    cells = [[label, *_four(misfit)] for label, misfit in rows]
    return Part(
        "Misfits", ("In mm.",), Grid(("", "mean", "largest", "std", "RMS"), cells, range(1, 5))
    )


def _four(misfit: Misfit) -> list[str]:
    return [f"{MM * v:.3f}" for v in (misfit.mean, misfit.max, misfit.std, misfit.rms)]


def _picture(fit: DHFit) -> Picture:
    return Picture(
        "rows",
        "Misfit of every row, and which estimates the readings hardly tell apart",
        "Grey with the drawing's links, blue with the fitted ones. Dark squares on the right are "
        "pairs that move together: vary the poses more to tell them apart.",
        (rows_picture(fit), correlations(fit)),
    )


def rows_picture(fit: DHFit) -> Figure:
    """Misfits of all rows before and after [mm], by row as an editor counts."""
    numbers = np.arange(len(fit.readings)) + FIRST_ROW
    with house_style():
        figure = new_figure(4.6, 3.6)
        axes = figure.add_subplot()
        for values, colour, label in (
            (fit.nominal_misfits(), BEFORE, "nominal"),
            (fit.misfits(), AFTER, "fitted"),
        ):
            sizes = MM * np.linalg.norm(values, axis=1)
            many = len(sizes) > MOST_VECTORS
            dots = axes.scatter(numbers, sizes, s=12, color=colour, alpha=0.75, linewidths=0,
                                label=label, rasterized=many)  # fmt: skip
            if not many:
                numbered(dots, numbers)
        axes.set(xlabel="row of samples.csv", ylabel="misfit [mm]", ylim=(0.0, None))
        axes.legend(loc="upper right")
        calm(axes)
        return figure


def _quantities(fit: DHFit) -> Part:
    rows = []
    for q in fit.quantities:
        factor, unit = UNITS[q.unit]
        change, share = factor * (q.value - q.nominal), fit.shares.get(q.name)
        numbers = [f"{factor * q.nominal:.3f}", f"{factor * q.value:.4f}", f"{change:+.4f}"]
        said = "" if share is None else f"{100 * share:.1f} %"
        rows.append([q.name, unit, *numbers, f"{factor * q.std:.4f}", said])
    columns = ("quantity", "unit", "nominal", "fitted", "change", "std. error", "share")
    words = (
        "Sums of parameters that the readings tell, most of one term. Share: how far the mean "
        "squared misfit comes back without this one alone.",
    )
    return Part("What the readings tell", words, Grid(columns, rows, range(2, 7)))


def _worst(fit: DHFit) -> Part:
    before, after = (np.linalg.norm(v, axis=1) for v in (fit.nominal_misfits(), fit.misfits()))
    rows = []
    for k in np.argsort(-after, kind="stable")[:SHOWN]:
        left = [f"{MM * v:+.3f}" for v in fit.misfits()[k]]
        sizes = [f"{MM * after[k]:.3f}", f"{MM * before[k]:.3f}"]
        rows.append([str(k + FIRST_ROW), *sizes, *left, "gross" if fit.gross[k] else ""])
    columns = ("row", "after", "before", "dx", "dy", "dz", "")
    words = ("Rows as an editor counts, the header being row 1; in mm, largest first.",)
    return Part("The rows that are missed most", words, Grid(columns, rows, range(6)))


def _frame(fit: DHFit) -> Part:
    rows = [[f"{v:.8f}" for v in row] for row in fit.T_robot_camera]
    tool = ", ".join(f"{MM * v:.3f}" for v in fit.tool)
    words = (f"Tool ({tool}) mm in the tip frame. T_robot_camera, lengths in m:",)
    return Part("Frame and tool", words, Grid(("", "", "", ""), rows, range(4), sorts=False))


def _untold(fit: DHFit) -> list[Part]:
    held = [f"{h.name}: {h.words}" for h in fit.identifiability.held]
    return [Part("What these poses cannot tell", (), None, held)] if held else []

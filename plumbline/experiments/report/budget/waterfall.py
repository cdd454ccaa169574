"""The gap budget as a waterfall: link by link up to the error now, cure by cure down again."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report.style import AFTER, GUILTY, MUTED, house_style, new_figure
from plumbline.optim.budget import Budget


def waterfall(budget: Budget) -> Figure:
    """Mean squares stacked, labelled in mm: squares add up, lengths do not."""
    square, after = budget.rms**2, budget.rms_after**2
    rises = [part.share * square for part in budget.parts]
    falls = [
        part.share_after * after - rise for part, rise in zip(budget.parts, rises, strict=True)
    ]
    cured = [k for k, part in enumerate(budget.parts) if part.curable]
    steps = [*rises, *(falls[k] for k in cured)]
    names = [p.name for p in budget.parts] + [f"{budget.parts[k].name}, cured" for k in cured]
    tops = np.cumsum(steps)
    with house_style():
        figure = new_figure(6.4, 0.9 + 0.3 * (len(steps) + 1))
        axes = figure.subplots()
        for k, (step, top) in enumerate(zip(steps, tops, strict=True)):
            axes.barh(k, 1e6 * step, left=1e6 * (top - step), color=GUILTY if step > 0 else AFTER)
        axes.barh(len(steps), 1e6 * after, color=MUTED)
        labels = [*names, f"left: {1e3 * budget.rms_after:.3g} mm"]
        axes.set_yticks(range(len(labels)), [label[:40] for label in labels])
        axes.invert_yaxis()
        axes.set_xlabel(f"mean square error [mm²]; now {1e3 * budget.rms:.3g} mm RMS")
    return figure

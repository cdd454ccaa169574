"""A gap budget on a page: the error now and after, the waterfall, link by link."""

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report.page.page import Grid, Page, Part, Picture, Tile
from plumbline.experiments.report.style import AFTER, GUILTY, MUTED, house_style, new_figure
from plumbline.optim.budget import Budget
from plumbline.optim.core.quantities import percent, quantity


def page(answer: Budget) -> Page:
    """The page of a budget."""
    low, high = (quantity(v, "m") for v in answer.interval)
    tiles = [
        Tile("now", quantity(answer.rms, "m"), f"RMS; 95 %: {low} to {high}"),
        Tile("after all cures", quantity(answer.rms_after, "m"), "RMS"),
        Tile("mend first", answer.first[0].name, f"gains {quantity(answer.first[0].gain, 'm')}"),
    ]
    picture = Picture(
        "waterfall",
        "Who contributes what",
        "Mean squares add up, lengths do not: link by link to the error now, then cure by cure.",
        (waterfall(answer),),
        wide=True,
    )
    return Page(
        name="Gap budget",
        verdict=f"{quantity(answer.rms, 'm')}, mostly {answer.first[0].name}",
        tone="explained",
        lead=(answer.headline + ".", answer.next_step()),
        tiles=tiles,
        parts=(picture, _links(answer)),
    )


def _links(answer: Budget) -> Part:
    rows = [
        [
            part.name,
            quantity(part.rms, "m"),
            percent(part.share),
            " to ".join(percent(v) for v in part.interval),
            quantity(part.rms_after, "m") if part.curable else "no cure",
            quantity(part.gain, "m"),
            part.origin,
        ]
        for part in answer.parts
    ]
    columns = ("link", "alone", "share", "95 %", "after", "mending it gains", "from")
    return Part("The links", (), Grid(columns, rows, (1, 2, 4, 5)))


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

"""A gap budget on a page: the error now and after, the waterfall, link by link."""

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report import style
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture, Tile
from plumbline.optim.budget import Budget
from plumbline.optim.budget.shares import COLUMNS, row_of
from plumbline.optim.core.quantities import quantity

LONGEST = 40  # characters of a label beside the waterfall


def page(answer: Budget) -> Page:
    """The page of a budget."""
    now, then = (
        " to ".join(quantity(v, "m") for v in span)
        for span in (answer.interval, answer.interval_after)
    )
    tiles = [
        Tile("now", quantity(answer.rms, "m"), f"RMS; 95 %: {now}"),
        Tile("after all cures", quantity(answer.rms_after, "m"), f"RMS; 95 %: {then}"),
        Tile("mend first", answer.first[0].name, f"gains {quantity(answer.first[0].gain, 'm')}"),
    ]
    rows = [[*row_of(part), part.origin] for part in answer.parts]
    links = Grid((*COLUMNS, "from"), rows, range(1, len(COLUMNS)))
    return Page(
        name="Gap budget",
        verdict=f"{quantity(answer.rms, 'm')}, mostly {answer.first[0].name}",
        tone="explained",
        lead=(answer.headline.replace("->", "→") + ".", answer.next_step()),
        tiles=tiles,
        parts=(Picture.of("budget.waterfall", waterfall(answer)), Part("The links", (), links)),
    )


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
    with style.drawing(6.4, 0.9 + 0.3 * (len(steps) + 1)) as (figure, axes):
        for k, (step, top) in enumerate(zip(steps, tops, strict=True)):
            (bar,) = axes.barh(
                k,
                1e6 * step,
                left=1e6 * (top - step),
                color=style.GUILTY if step > 0 else style.AFTER,
            )
            style.says(bar, f"{names[k]}: {1e6 * step:+.3g} mm²")
        axes.barh(len(steps), 1e6 * after, color=style.MUTED)
        labels = [*names, f"left: {1e3 * budget.rms_after:.3g} mm"]
        axes.set_yticks(
            range(len(labels)),
            [label if len(label) <= LONGEST else f"{label[: LONGEST - 1]}…" for label in labels],
        )
        axes.invert_yaxis()
        axes.set_xlabel(f"mean square error [mm²]; now {1e3 * budget.rms:.3g} mm RMS")
    return figure

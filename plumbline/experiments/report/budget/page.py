"""A gap budget on a page: the error now and after, the waterfall, link by link."""

from __future__ import annotations

from plumbline.experiments.report.budget.waterfall import waterfall
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture, Tile
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

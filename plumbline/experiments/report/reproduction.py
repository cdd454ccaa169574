"""A reproduced paper on a page, the MPC's among them: pictures, tables sorted by a click, notes."""

from functools import partial

from matplotlib.figure import Figure

from plumbline.experiments.report import style
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture
from plumbline.experiments.reproduce import Compared, Reproduction

STATED = {
    "paper": style.GUILTY,
    "asked": style.FLOOR,
}  # what a figure is held against, and its colour
DECADE = 10.0  # largest over smallest figure, from which on a scale is logarithmic


def page(found: Reproduction) -> Page:
    """The page of a reproduction."""
    pictures = [partial(_picture, k, one) for k, one in enumerate(found.compared)]
    parts = [
        Part(table.title, (), Grid(table.columns, table.rows, range(1, len(table.columns))))
        for table in found.tables
    ]
    notes = [Part("To be known", (), None, found.notes)] if found.notes else []
    return Page(
        name=found.source,
        verdict=found.title,
        tone="partly-explained",
        lead=(found.said or "The paper's figures beside ours, where it gives one.",),
        tiles=(),
        parts=(*pictures, *parts, *notes),
    )


def _picture(k: int, shown: Compared) -> Picture:
    drawn = compared(shown)
    return Picture.of("reproduction.compared", drawn, number=k, title=shown.title)


def compared(shown: Compared) -> Figure:
    """A row a figure, all on one scale."""
    names, values = zip(*shown.rows, strict=True)
    sizes = [v[key] for v in values for key in ("value", *STATED) if v.get(key)]
    with style.drawing(6.4, 0.9 + 0.26 * len(names)) as (figure, axes):
        style.calm(axes)
        for k, (name, one) in enumerate(shown.rows):
            low = min(one.get("std", 0.0), one["value"])  # no length is below zero
            axes.plot(
                [one["value"] - low, one["value"] + one.get("std", 0.0)], [k, k], color=style.AFTER
            )
            (dot,) = axes.plot(one["value"], k, "o", color=style.AFTER, ms=5)
            style.says(dot, f"{name}: {one['value']:.3g} {one['unit']}")
            for key in STATED.keys() & one.keys():
                (mark,) = axes.plot(one[key], k, "D", color=STATED[key], mfc="none", ms=6)
                style.says(mark, f"{name}: {one[key]:.3g} {one['unit']}, {key}")
        if max(sizes) > DECADE * min(sizes) > 0.0:
            axes.set_xscale("log")
        axes.set_yticks(range(len(names)), names)
        axes.invert_yaxis()
        held = ", ".join(key for key in STATED if any(key in one for one in values))
        axes.set_xlabel(f"[{values[0]['unit']}]" + (f"; diamonds: {held}" if held else ""))
    return figure

"""A reproduced paper on a page, the MPC's among them: its tables, sorted by a click, and notes."""

from plumbline.experiments.report.page.page import Grid, Page, Part
from plumbline.experiments.reproduce import Reproduction


def page(found: Reproduction) -> Page:
    """The page of a reproduction."""
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
        parts=(*parts, *notes),
    )

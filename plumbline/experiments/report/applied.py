"""A model on another recording, on a page: before, after, what changed, what was not covered."""

from plumbline.experiments.report.page.page import Grid, Page, Part, Tile
from plumbline.optim.core.quantities import percent, quantity
from plumbline.optim.model import Applied
from plumbline.optim.recording.table import HEADER


def page(answer: Applied) -> Page:
    """The page of a model that was tried on another recording."""
    before, after, promised = (
        quantity(v, answer.unit) for v in (answer.before, answer.after, answer.promised)
    )
    return Page(
        name=answer.recording,
        verdict="The model holds" if answer.holds else "The model does not hold",
        tone="explained" if answer.holds else "outside-library",
        lead=(answer.words.replace("->", "→"),),
        tiles=[
            Tile("without the causes", before, f"RMS of {answer.rows} rows"),
            Tile("with them", after, "held as they were found"),
            Tile("promised", promised, "left where they were found"),
            Tile("outside of its range", percent(answer.outside_share), "of the rows"),
        ],
        parts=[part for part in (_changes(answer), _outside(answer), _left(answer)) if part],
        warnings=answer.judged.failures,
    )


def _changes(answer: Applied) -> Part | None:
    rows = [
        [c.label, f"{c.z:.1f}", percent(c.saves), "yes" if c.new else "no"] for c in answer.changes
    ]
    words = "What each would save of what is left, were it fitted again; z in standard errors."
    columns = ("cause", "z", "saves", "new")
    return (
        Part("What seems to have changed", (words,), Grid(columns, rows, (1, 2))) if rows else None
    )


def _outside(answer: Applied) -> Part | None:
    rows = [[name, percent(share)] for name, share in answer.outside_columns.items()]
    words = "Rows that leave the range in which the model was fitted, column by column."
    return (
        Part("Beyond its range", (words,), Grid(("column", "rows"), rows, (1,))) if rows else None
    )


def _left(answer: Applied) -> Part | None:
    points = [f"{name}: not carried over" for name in answer.left_out]
    if answer.gross:
        points.append(f"taken for gross errors, {HEADER}: {', '.join(map(str, answer.gross))}")
    return Part("What was left out", (), None, points) if points else None

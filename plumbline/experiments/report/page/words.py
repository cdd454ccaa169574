"""A page on a terminal: the same words and tables, without its pictures.

What comes from the data is shown as it stands: no markup of a console's, nothing unprintable.
"""

from collections.abc import Sequence

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from plumbline.experiments.report.page.page import Grid, Page, Part


def print_page(page: Page, console: Console | None = None) -> None:
    """Print a page's words; parts that are too long for a terminal stay on paper."""
    out = console or Console(highlight=False)
    _line(out, f"{page.name}: {page.verdict}", "bold")
    for line in page.lead:
        _line(out, line)
    for line in page.warnings:
        _line(out, f"! {line}", "bold")
    if page.tiles:
        out.print()
        out.print(_table(("", "", ""), [[t.name, t.value, t.note] for t in page.tiles]))
    for part in page.parts:
        if isinstance(part, Part) and not part.on_paper:
            _print_part(out, part)


def _print_part(out: Console, part: Part) -> None:
    _line(out, f"\n{part.title}", "bold")
    for line in part.words:
        _line(out, line, "dim")
    if part.table is not None:
        out.print(_grid(part.table))
    for line in part.points:
        _line(out, f"  • {line}")


def _grid(grid: Grid) -> Padding:
    return _table(grid.columns, grid.rows, grid.numbers)


def _table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()
) -> Padding:
    table = Table(box=None, show_header=any(columns), header_style="dim", pad_edge=False)
    for k, name in enumerate(columns):
        table.add_column(_shown(name), justify="right" if k in numbers else "left")
    for row in rows:
        table.add_row(*(_shown(cell) for cell in row))
    return Padding(table, (0, 0, 0, 2), expand=False)


def _line(out: Console, text: str, style: str = "") -> None:
    out.print(_shown(text, style), soft_wrap=True)


def _shown(text: str, style: str = "") -> Text:
    return Text("".join(c if c.isprintable() or c == "\n" else "?" for c in text), style)

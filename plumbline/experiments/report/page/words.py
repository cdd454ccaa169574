"""A page on a terminal: the same words and tables, without its pictures.

What comes from the data is shown as it stands: no markup of a console's, nothing unprintable. Lines
are broken between words where a terminal ends, and nowhere else.
"""

from rich.console import Console, JustifyMethod, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from plumbline.experiments.report.page.page import Grid, Page, Part

WORD = 14  # characters of a table's words that are not broken
TONES = {
    "no-gap": "bold green",
    "explained": "bold green",
    "partly-explained": "bold cyan",
    "outside-library": "bold yellow",
}


def console(width: int | None = None) -> Console:
    """A console, so many characters wide where no terminal says how many there are."""
    out = Console(highlight=False)
    return out if out.is_terminal or width is None else Console(highlight=False, width=width)


def print_page(page: Page, out: Console) -> None:
    """Print a page's words; parts that are too long for a terminal stay on paper."""
    heading = Text.assemble(_shown(f"{page.name}: ", "bold"), _shown(page.verdict, "bold"))
    heading.stylize(TONES.get(page.tone, "bold"), len(page.name) + 2)
    _print(out, heading)
    for line in page.lead:
        _print(out, _shown(line))
    for line in page.warnings:
        _print(out, _shown(f"! {line}", "bold"))
    if page.tiles:
        out.print()
        tiles = Grid(("", "", ""), [[t.name, t.value, t.note] for t in page.tiles])
        out.print(_indented(table_of(tiles), 2))
    for part in page.parts:
        if isinstance(part, Part) and not part.on_paper:
            _print_part(out, part)
    for section in page.sections:
        out.print()
        print_page(section, out)


def _print_part(out: Console, part: Part, title_at: int = 0, at: int = 2) -> None:
    """A part, its heading so many characters in, and what it says so many."""
    if not title_at:
        out.print()
    if part.title:
        _print(out, _titled(part), title_at)
    for line in part.words:
        _print(out, _shown(line, "dim"), at)
    if part.table is not None:
        out.print(_indented(table_of(part.table), at))
    for line in part.points[: part.most]:
        _print(out, _shown(f"• {line}"), at)
    if more := len(part.points) - len(part.points[: part.most]):
        _print(out, _shown(f"• and {more} more, listed in JSON and report"), at)
    for one in part.parts:
        if one.folded:
            _print_folded(out, one, at)
        else:
            _print_part(out, one, at, at + 4)


def _print_folded(out: Console, part: Part, at: int) -> None:
    """What opens at a click on paper: what it is of, and the titles in it."""
    told = ", with values in JSON and report:" if part.parts else ""
    _print(out, _shown(part.title + told), at)
    for one in part.parts:
        _print(out, _titled(one), at)


def _titled(part: Part) -> Text:
    return Text.assemble(_shown(part.title, "bold"), _shown(f"  {part.note}" if part.note else ""))


def table_of(grid: Grid) -> Table:
    """A table whose lines break between words, and whose long names fold: none is cut off."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim", show_header=any(grid.columns))
    for k, name in enumerate(grid.columns):
        side: JustifyMethod = "right" if k in grid.numbers else "left"
        cells = " ".join((name, *(row[k] for row in grid.rows)))
        longest = max(map(len, cells.split()), default=0)
        table.add_column(_shown(name), justify=side, overflow="fold", min_width=min(longest, WORD))
    for row in grid.rows:
        table.add_row(*(_shown(cell) for cell in row))
    return table


def _print(out: Console, text: Text, at: int = 0) -> None:
    if out.is_terminal:
        out.print(_indented(text, at))
    else:
        out.print(Text(" " * at) + text, soft_wrap=True)


def _indented(what: RenderableType, at: int) -> Padding:
    return Padding(what, (0, 0, 0, at), expand=False)


def _shown(text: str, style: str = "") -> Text:
    return Text("".join(c if c.isprintable() or c == "\n" else "?" for c in text), style)

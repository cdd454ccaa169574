"""A verdict in plain words on a terminal."""

from collections.abc import Iterator
from typing import Any

from rich.console import Console, Group, JustifyMethod, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from plumbline.experiments.report.diagnosis import several
from plumbline.experiments.report.diagnosis.phrases import (
    MOST_CAUSES,
    Elsewhere,
    confounded_lines,
    distrusted_words,
    further,
    suggestion_words,
)
from plumbline.experiments.report.page.page import Grid
from plumbline.optim.core.quantities import chance, counted, percent, quantity
from plumbline.optim.diagnosis.findings import Cause, Outcome, Verdict
from plumbline.optim.diagnosis.verdict import words

COLOURS = {
    Outcome.NO_GAP: "bold green",
    Outcome.EXPLAINED: "bold green",
    Outcome.PARTLY: "bold cyan",
    Outcome.OUTSIDE: "bold yellow",
}
WORD = 14  # characters of a table's words that are not broken
BAR = 30  # characters of the longest bar
MOST_RIVALS = 5  # candidates that are shown with the causes
MOST_LINES = 12  # of what the recording cannot see
MOST_ROWS = 3  # of what to record next
LIKELY = 0.01  # probability below which a rival is not worth a line


def print_verdict(verdict: Verdict, console: Console, elsewhere: Elsewhere | None = None) -> None:
    """Print a verdict, and how its model does on another recording if that is known."""
    console.print(Group(*_sections(verdict, elsewhere)), highlight=False)


def print_sections(answer: Any, console: Console) -> None:
    """Print a verdict on several recordings, section by section where no one fit holds them."""
    sections = getattr(answer, "sections", ())
    if sections:
        console.print(_heading(answer.verdict), highlight=False)
    for one in sections or (answer,):
        if sections:
            console.print(f"\n{one.recording.observation.upper()}\n", style="bold", markup=False)
        print_verdict(one.verdict, console)


def _sections(verdict: Verdict, elsewhere: Elsewhere | None) -> Iterator[RenderableType]:
    yield _heading(verdict)
    yield from (Text(line, style="bold red") for line in verdict.warnings)
    yield from _gap(verdict, elsewhere)
    if verdict.causes:
        yield from _section("Causes, with their probabilities", *_causes(verdict))
    for title, grid in (
        ("Joint by joint, on what was left out", several.joints(verdict)),
        ("Recording by recording", several.recordings(verdict)),
        ("What carries over", several.transfer(verdict)),
    ):
        if grid.rows:
            yield from _section(title, _grid(grid))
    title = "What may be at work, place by place" if verdict.tree else "Beyond the library"
    yield from _section(title, *map(_bullet, (*words.tree_lines(verdict), *_beyond(verdict))))
    if verdict.where:
        yield from _section("Where", _where(verdict))
    yield from _rivals(verdict)
    if unknown := tuple(_unknown(verdict)):
        yield from _section("What this recording cannot tell", *unknown)
    if verdict.next:
        lines = [suggestion_words(entry) for entry in verdict.next[:MOST_ROWS]]
        more = len(verdict.next) - len(lines)
        lines += [f"and {counted(more, 'row')} more: see plumbline next"] if more else []
        yield from _section("What to record next", *map(_bullet, lines))
    gross = () if verdict.recordings else verdict.distrusted_rows  # which are told one by one
    notes = [*filter(None, [distrusted_words(gross)]), *verdict.notes]
    if notes:
        yield from _section("Notes", *map(_bullet, notes))


def _heading(verdict: Verdict) -> Text:
    noise = words.noise_words(verdict.noise, verdict.gap.unit)
    return Text.assemble(
        (verdict.recording, "bold"),
        (f": {counted(verdict.rows, 'row')}; noise {noise}\n\n", "dim"),
        (verdict.verdict.value.upper(), COLOURS[verdict.verdict]),
        f"  {verdict.meaning}",
    )


def _gap(verdict: Verdict, elsewhere: Elsewhere | None) -> Iterator[RenderableType]:
    gap = verdict.gap
    sizes = [quantity(v, gap.unit) for v in (gap.before, gap.after, gap.noise_floor)]
    line = Text.assemble(
        (f"{sizes[0]} → {sizes[1]}", "bold"), f"   ({words.floor_words(verdict)}: {sizes[2]})"
    )
    parts = [line, Text(words.shrink_words(verdict))]
    if elsewhere is not None:
        parts.append(Text(elsewhere.words))
    yield from _section("Gap", *parts)


def _section(title: str, *parts: RenderableType) -> Iterator[RenderableType]:
    yield Text(f"\n{title}", style="bold")
    yield from (Padding(part, (0, 0, 0, 2), expand=False) for part in parts)


def _causes(verdict: Verdict) -> Iterator[RenderableType]:
    """The first with their values, the others a line each."""
    yield from map(_cause, verdict.causes[:MOST_CAUSES])
    smaller = verdict.causes[MOST_CAUSES:]
    if smaller:
        yield Text(f"{further(smaller)}, with values in JSON and report:", "dim")
        yield from map(_title, smaller)


def _title(cause: Cause) -> Text:
    sensitivity = words.sensitivity_words(cause)
    return Text.assemble(
        (cause.label, "bold"),
        f"  {chance(cause.probability)}  ",
        (f"({sensitivity})  " if sensitivity else "", "dim"),
        (words.without_words(cause), "dim"),
    )


def _cause(cause: Cause) -> RenderableType:
    """A cause with its sentence and its values."""
    table = Table.grid(padding=(0, 2))
    for name, estimate in words.plain_parameters(cause).items():
        table.add_row(Text(name), Text(words.estimate_words(estimate)), Text(estimate.doc, "dim"))
    found = words.ripples(cause)
    body: list[RenderableType] = [Text(words.cause_words(cause), "italic")] if cause.words else []
    if table.row_count:
        body.append(table)
    if found:
        body.append(Text(words.ripple_words(found)))
    return Group(_title(cause), *(Padding(part, (0, 0, 0, 4), expand=False) for part in body))


def _grid(grid: Grid) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for k, name in enumerate(grid.columns):
        side: JustifyMethod = "right" if k in grid.numbers else "left"
        cells = " ".join((name, *(row[k] for row in grid.rows)))
        longest = max(map(len, cells.split()))
        # Lines break between words, and long names fold: those that end alike stay apart.
        table.add_column(name, justify=side, overflow="fold", min_width=min(longest, WORD))
    for row in grid.rows:
        table.add_row(*map(Text, row))
    return table


def _where(verdict: Verdict) -> Table:
    largest = max(max(place.share for place in verdict.where), 1e-12)
    table = Table.grid(padding=(0, 2))
    for place in verdict.where:
        bar = "█" * max(round(BAR * place.share / largest), 1 if place.share > 0.0 else 0)
        table.add_row(
            Text(words.place_words(place.stage, place.element)),
            Text(percent(place.share)),
            Text(bar, "yellow"),
        )
    return table


def _rivals(verdict: Verdict) -> Iterator[RenderableType]:
    """Candidates that are not in the verdict and yet may be at work."""
    guilty = {(c.effect, c.element) for c in verdict.causes}
    others = [c for c in verdict.candidates if (c.effect, c.element) not in guilty]
    others = sorted(others, key=lambda c: -c.probability)
    likely = [c for c in others if c.probability >= LIKELY][:MOST_RIVALS]
    if likely:
        lines = [f"{c.label}: probability {chance(c.probability)}" for c in likely]
        yield from _section("Considered, and not in the verdict", *map(_bullet, lines))


def _beyond(verdict: Verdict) -> Iterator[str]:
    yield f"something outside of the library: {chance(verdict.outside_probability)}"
    if shared := words.shared_words(verdict):
        yield shared
    if verdict.outside_depends_on:
        yield words.left_over(verdict.outside_depends_on)


def _unknown(verdict: Verdict) -> Iterator[RenderableType]:
    yield from (_bullet(f"cannot tell {line}") for line in confounded_lines(verdict.causes))
    unseen = words.merged(verdict.unobservable)
    yield from (_bullet(f"cannot see {line}") for line in unseen[:MOST_LINES])
    if len(unseen) > MOST_LINES:
        yield _bullet(f"cannot see {len(unseen) - MOST_LINES} more, listed in JSON and report")


def _bullet(line: str) -> RenderableType:
    table = Table.grid(padding=(0, 1))
    table.add_row("•", Text(line))
    return table

"""A score in words: one table of all figures by difficulty, one of single causes by effect."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE
from rich.console import Console, JustifyMethod
from rich.table import Table

from plumbline.experiments.withheld.calibration import Calibration
from plumbline.experiments.withheld.measures import MEASURES
from plumbline.experiments.withheld.scoring import Group, Mistake, Score
from plumbline.optim.core.shares import Median, Share

LEVELS = ("faint", "slight", "clear", "no gap", "unstated")
MOST_MISTAKES = 12
WIDTH = 120


def percent(share: Share) -> str:
    """A share with its interval, in percent, such as ``93.2 (88-96)``."""
    if share.value is None or share.low is None or share.high is None:
        return ""
    return _spanned(share.value, share.low, share.high)


def median(found: Median) -> str:
    """A median in percent, with its interval where there are values enough for one."""
    if found.value is None:
        return ""
    if found.low is None or found.high is None:
        return _shown(found.value)
    return _spanned(found.value, found.low, found.high)


def _spanned(value: float, low: float, high: float) -> str:
    return f"{_shown(value)} ({100 * low:.0f}-{100 * high:.0f})"


def _shown(value: float) -> str:
    return f"{100 * value:.1f}".removesuffix(".0")


def by_level(score: Score) -> list[Group]:
    """All cases, then the levels from faint to clear."""
    found = [group for group in score.groups if group.by == "level"]
    return [score.overall, *sorted(found, key=lambda group: LEVELS.index(group.name))]


def rows_of(groups: Sequence[Group]) -> list[tuple[str, ...]]:
    """Every figure that any of the groups has, as text, headed by its words."""
    rows: list[tuple[str, ...]] = []
    for measure in MEASURES:
        shares = [group.share(measure.key) for group in groups]
        if any(share.of for share in shares):
            rows.append((measure.words, *(percent(share) for share in shares)))
    if any(group.shrink.of for group in groups):
        rows.append(("removable gap removed, median", *(median(g.shrink) for g in groups)))
    return rows


def error_words(name: str, found: Calibration) -> str:
    """A calibration error in one line."""
    if found.ece is None or found.low is None or found.high is None:
        return f"{name}: nothing stated"
    return (
        f"{name}: ECE {found.ece:.3f} ({found.low:.3f}-{found.high:.3f}), "
        f"{found.statements} statements"
    )


def calibration_lines(score: Score) -> list[str]:
    """The four calibration errors."""
    return [
        error_words("causes named, confounded right", score.named),
        error_words("causes named, strictly", score.named_strictly),
        error_words("candidates at 0.05 and more, strictly", score.candidates),
        error_words("something outside the library", score.outside),
    ]


def mistakes(score: Score) -> list[Mistake]:
    """What was most often taken for what."""
    wrong = [m for m in score.confusion if m.truth != m.answer]
    return sorted(wrong, key=lambda m: -m.count)


def seal_words(score: Score) -> str:
    """Whether anything vouches for the set."""
    if score.sealed:
        return f"sealed, ledger {score.ledger[:16]}"
    return "not sealed: no ledger vouches for recordings and truth"


def wide_console() -> Console:
    """A console on which a table of all figures fits, unless a terminal says it is narrower."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=WIDTH)


def print_score(score: Score, console: Console) -> None:
    """Print a score."""
    late = f", {score.missing} without a verdict" if score.missing else ""
    console.print(f"[bold]{score.cases} withheld cases[/bold]{late} ({seal_words(score)})\n")
    groups = by_level(score)
    table = Table(title="Percent, with 95 % intervals", title_justify="left", box=SIMPLE)
    table.add_column("", no_wrap=True)
    for group in groups:
        table.add_column(f"{group.name} ({group.cases})", justify="right", no_wrap=True)
    for row in rows_of(groups):
        table.add_row(*row)
    console.print(table)
    _print_effects(score, console)
    for line in calibration_lines(score):
        console.print(line)
    for mistake in mistakes(score)[:MOST_MISTAKES]:
        console.print(f"{mistake.truth} taken for {mistake.answer}: {mistake.count}")


def _print_effects(score: Score, console: Console) -> None:
    groups = [group for group in score.groups if group.by == "effect"]
    if not groups:
        return
    table = Table(title="Single causes, by effect", title_justify="left", box=SIMPLE)
    for heading in (
        "effect",
        "cases",
        "right",
        "or confounded",
        "best-ranked or confounded",
        "flagged outside",
    ):
        justify: JustifyMethod = "left" if heading == "effect" else "right"
        table.add_column(heading, justify=justify, no_wrap=True)
    for group in groups:
        keys = ("top1_element", "top1_element_or_twin", "ranked_element_or_twin", "outside_hits")
        table.add_row(group.name, str(group.cases), *(percent(group.share(key)) for key in keys))
    console.print(table)

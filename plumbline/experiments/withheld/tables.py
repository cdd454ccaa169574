"""A score in words: figures with their intervals, by difficulty."""

from collections.abc import Sequence

from plumbline.experiments.withheld.calibration import Calibration
from plumbline.experiments.withheld.measures import MEASURES
from plumbline.experiments.withheld.scoring import Group, Mistake, Score
from plumbline.optim.core.shares import Median, Share

LEVELS = ("faint", "slight", "clear", "no gap", "unstated")


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
        f"{found.statements} statements ({found.chance:.3f} by chance)"
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

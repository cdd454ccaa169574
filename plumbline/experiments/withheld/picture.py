"""A score as a page: what was taken for what, can probabilities be believed."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from plumbline.experiments.report import style
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture
from plumbline.experiments.withheld import scoring
from plumbline.experiments.withheld.calibration import Calibration
from plumbline.experiments.withheld.scoring import Score

MOST_MISTAKES = 12  # lines, what a page has room for (looks only)
LAST = ("outside", "no gap", "partly-explained", "refused", "failed")


def _order(score: Score) -> list[str]:
    names = {m.truth for m in score.confusion} | {m.answer for m in score.confusion}
    return sorted(names - set(LAST)) + [name for name in LAST if name in names]


def _confusion(score: Score) -> Figure:
    """Rows are truths, columns first answers; shade is the share of the row, numbers are cases."""
    order = _order(score)
    size = 2.6 + 0.27 * len(order)
    with style.drawing(size + 0.6, size) as (figure, axes):
        if not order:
            axes.text(0, 0, "no case of at most one cause", color=style.MUTED, ha="center")
            axes.set(xlim=(-1, 1), ylim=(-1, 1))
            axes.axis("off")
            return figure
        counts = np.zeros((len(order), len(order)))
        for mistake in score.confusion:
            counts[order.index(mistake.truth), order.index(mistake.answer)] = mistake.count
        share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        axes.imshow(np.ma.masked_equal(share, 0), cmap=style.SHARES, vmin=0, vmax=1)
        look = {"ha": "center", "va": "center", "size": 7, "color": style.INK}
        for i, j in np.argwhere(counts > 0):
            axes.text(j, i, f"{counts[i, j]:.0f}", weight="bold" if i == j else "normal", **look)
        labels = [name.replace("_", " ") for name in order]
        axes.set_xticks(range(len(order)), labels, rotation=90, size=7.5)
        axes.set_yticks(range(len(order)), labels, size=7.5)
        axes.set(xlabel="first answer", ylabel="truth", title="What was taken for what")
    return figure


def _reliability(score: Score) -> Figure:
    """Share of right statements over their probability, with intervals and how many they were."""
    with style.drawing(4.6, 4.6, 2, sharex=True, height_ratios=(3, 1)) as (figure, (upper, lower)):
        upper.plot([0, 1], [0, 1], color=style.FAINT, linewidth=1)
        for found, colour, label, shift in (
            (score.named, style.AFTER, "causes named, confounded right", -1),
            (score.candidates, style.BEFORE, "all candidates, strictly", 0),
            (score.outside, style.GUILTY, "outside the library", 1),
        ):
            _curve(style.calm(upper), found, colour, label, 0.008 * shift)
            at = [0.5 * (b.low + b.high) + 0.026 * shift for b in found.curve]
            style.calm(lower).bar(at, [b.right.of for b in found.curve], 0.024, color=colour)
        upper.set(ylabel="share that is right", ylim=(-0.03, 1.03))
        upper.legend(loc="upper left")
        upper.set_title("Stated probabilities against what came true")
        lower.set(xlabel="stated probability", ylabel="statements", xlim=(-0.02, 1.02))
        lower.set_yscale("symlog", linthresh=1)
    return figure


def _curve(axes: Axes, found: Calibration, colour: str, label: str, shift: float) -> None:
    if not found.curve:
        return
    at = np.array([b.stated for b in found.curve]) + shift
    value, low, high = (
        np.array([getattr(b.right, end) for b in found.curve]) for end in ("value", "low", "high")
    )
    reach = np.maximum([value - low, high - value], 0.0)
    axes.errorbar(
        at, value, reach, color=colour, marker="o", markersize=4, linewidth=1, label=label
    )


def page(score: Score) -> Page:
    """The score as a page: for a browser, or for a terminal."""
    late = (f"{score.missing} cases have no verdict.",) if score.missing else ()
    groups = scoring.by_level(score)
    columns = ("", *(f"{group.name} ({group.cases})" for group in groups))
    most = scoring.mistakes(score)[:MOST_MISTAKES]
    wrong = [f"{m.truth} taken for {m.answer}: {m.count}" for m in most]
    percent = Grid(columns, scoring.rows_of(groups), range(1, 99))
    return Page(
        name=f"{score.cases} withheld cases",
        verdict=scoring.seal_words(score),
        tone="explained" if score.sealed else "partly-explained",
        lead=late,
        tiles=(),
        parts=(
            Part("Percent, with 95 % intervals", (), percent),
            *_by_effect(score),
            Part("Probabilities", (), None, scoring.calibration_lines(score)),
            Picture.of("withheld.curve", _reliability(score)),
            Picture.of("withheld.confusion", _confusion(score)),
            *([Part("Most often taken for another", (), None, wrong)] if wrong else []),
        ),
    )


def _by_effect(score: Score) -> list[Part]:
    groups = [group for group in score.groups if group.by == "effect"]
    shown = {
        "right": "top1_element", "or confounded": "top1_element_or_confounded",
        "best-ranked or confounded": "ranked_element_or_confounded",
        "flagged outside": "outside_hits",
    }  # fmt: skip
    rows = [
        (g.name, str(g.cases), *(scoring.percent(g.share(key)) for key in shown.values()))
        for g in groups
    ]
    table = Grid(("effect", "cases", *shown), rows, range(1, 2 + len(shown)))
    return [Part("Single causes, by effect", (), table)] if rows else []

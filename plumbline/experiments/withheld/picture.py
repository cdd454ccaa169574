"""A score as one picture: what was taken for what, and whether probabilities can be believed."""

from __future__ import annotations

import html
import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from plumbline.experiments.report.style import (
    AFTER,
    BEFORE,
    FAINT,
    GUILTY,
    INK,
    MUTED,
    PAPER,
    SHARES,
    calm,
    house_style,
    new_figure,
    svg,
)
from plumbline.experiments.withheld.calibration import Calibration
from plumbline.experiments.withheld.scoring import Score
from plumbline.experiments.withheld.tables import by_level, calibration_lines, rows_of, seal_words
from plumbline.kinematics.files import write_whole

LAST = ("outside", "no gap", "partly-explained", "refused", "failed")
CSS = f"""
:root {{ --ink: {INK}; --muted: {MUTED}; --faint: {FAINT}; --paper: {PAPER}; }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #e6e8ea; --muted: #9aa1aa; --faint: #4a4f56; --paper: #17191c; }}
}}
body {{ background: var(--paper); color: var(--ink); font: 15px/1.5 system-ui, sans-serif;
        max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }}
table {{ border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }}
td, th {{ text-align: right; padding: 0.15rem 0.7rem; border-bottom: 1px solid var(--faint); }}
td:first-child, th:first-child {{ text-align: left; }}
svg {{ width: 100%; height: auto; }} p {{ color: var(--muted); }}
"""


def confusion_figure(score: Score) -> Figure:
    """Rows are truths, columns first answers; shade is the share of the row, numbers are cases."""
    size = 2.6 + 0.27 * len(_order(score))
    with house_style():
        figure = new_figure(size + 0.6, size)
        _confusion(figure, score)
    return figure


def reliability_figure(score: Score) -> Figure:
    """Share of right statements over their probability, with intervals and how many they were."""
    with house_style():
        figure = new_figure(4.6, 4.6)
        _reliability(figure, score)
    return figure


def _order(score: Score) -> list[str]:
    names = {m.truth for m in score.confusion} | {m.answer for m in score.confusion}
    return sorted(names - set(LAST)) + [name for name in LAST if name in names]


def _confusion(figure: Figure | SubFigure, score: Score) -> None:
    order, axes = _order(score), figure.add_subplot()
    if not order:
        axes.text(0, 0, "no case of at most one cause", color=MUTED, ha="center")
        axes.set(xlim=(-1, 1), ylim=(-1, 1))
        axes.axis("off")
        return
    counts = np.zeros((len(order), len(order)))
    for mistake in score.confusion:
        counts[order.index(mistake.truth), order.index(mistake.answer)] = mistake.count
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(np.ma.masked_equal(share, 0), cmap=SHARES, vmin=0, vmax=1)
    for i, j in np.argwhere(counts > 0):
        weight = "bold" if i == j else "normal"
        words = f"{counts[i, j]:.0f}"
        axes.text(j, i, words, ha="center", va="center", size=7, color=INK, weight=weight)
    labels = [name.replace("_", " ") for name in order]
    axes.set_xticks(range(len(order)), labels, rotation=90, size=7.5)
    axes.set_yticks(range(len(order)), labels, size=7.5)
    axes.set(xlabel="first answer", ylabel="truth")
    axes.set_title("What was taken for what")


def _reliability(figure: Figure | SubFigure, score: Score) -> None:
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    upper.plot([0, 1], [0, 1], color=FAINT, linewidth=1)
    for found, colour, label, shift in (
        (score.named, AFTER, "causes named, confounded right", -1),
        (score.candidates, BEFORE, "all candidates, strictly", 0),
        (score.outside, GUILTY, "outside the library", 1),
    ):
        _curve(calm(upper), found, colour, label, 0.008 * shift)
        at = [0.5 * (b.low + b.high) + 0.026 * shift for b in found.curve]
        calm(lower).bar(at, [b.right.of for b in found.curve], 0.024, color=colour)
    upper.set(ylabel="share that is right", ylim=(-0.03, 1.03))
    upper.legend(loc="upper left")
    upper.set_title("Stated probabilities against what came true")
    lower.set(xlabel="stated probability", ylabel="statements", xlim=(-0.02, 1.02))
    lower.set_yscale("symlog", linthresh=1)


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


def write_picture(score: Score, path: Path) -> None:
    """Write the score as a page (``.html``) or as the two pictures side by side (``.png``).

    Raises:
        OSError: The file cannot be written.
    """
    if path.suffix.lower() == ".png":
        write_whole(path, _png(score))
    else:
        write_whole(path, page(score))


def _png(score: Score) -> bytes:
    """Both figures on one sheet, as pixels."""
    size = max(2.6 + 0.27 * len(_order(score)), 4.6)
    with house_style():
        sheet = new_figure(size + 5.2, size)
        grid = sheet.add_gridspec(1, 2, width_ratios=(size + 0.6, 4.6))
        _confusion(sheet.add_subfigure(grid[0]), score)
        _reliability(sheet.add_subfigure(grid[1]), score)
        pixels = io.BytesIO()
        sheet.savefig(pixels, format="png", dpi=160, facecolor=PAPER)
    return pixels.getvalue()


def page(score: Score) -> str:
    """The score as one HTML file that fetches nothing."""
    groups = by_level(score)
    heads = "".join(f"<th>{html.escape(g.name)} ({g.cases})</th>" for g in groups)
    body = "\n".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>"
        for row in rows_of(groups)
    )
    lines = "<br>".join(html.escape(line) for line in calibration_lines(score))
    confusion = svg(confusion_figure(score), "confusion", "What was taken for what, in cases")
    curve = svg(reliability_figure(score), "curve", "Share of right statements by probability")
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Withheld check</title><style>{CSS}</style></head>
<body><h1>{score.cases} withheld cases</h1><p>{html.escape(seal_words(score))}</p>
<h2>Percent, with 95 % intervals</h2><table><tr><th></th>{heads}</tr>
{body}</table>
<h2>Probabilities</h2><p>{lines}</p>{curve}
<h2>Confusion</h2><p>Cases of at most one cause. The shade is the share of the row.</p>{confusion}
</body></html>
"""

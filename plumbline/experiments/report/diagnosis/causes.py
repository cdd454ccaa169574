"""What is to blame: the ranking of causes, their staircase, where they sit, their curves."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from plumbline.experiments.report import style
from plumbline.experiments.report.diagnosis.phrases import LIKELY
from plumbline.experiments.report.style import AFTER, INK, calm, house_style, new_figure
from plumbline.optim.core.quantities import chance, percent, scaled, significant
from plumbline.optim.diagnosis.findings import Cause, Step, Verdict
from plumbline.optim.diagnosis.verdict.words import floor_words, place_words

WIDTH = 5.2  # [in]
MOST_BARS = 14  # what a page has room for (looks only)
FEWEST_RIVALS, MOST_RIVALS = 3, 10  # that are drawn, however probable (looks only)
ROW = 0.27  # height of a bar with its gap [in]
MOST_CURVES = 6  # what a page has room for (looks only)
LONGEST = 44  # characters of a label beside its bar (looks only)
HEIGHT = 1.5  # [in] of one curve
MRAD = 1e3  # of a radian


def ranking(verdict: Verdict) -> Figure:
    """Probabilities of the candidates, those of the verdict in colour."""
    shown = ranked(verdict)
    guilty = {(c.effect, c.element) for c in verdict.causes}
    colours = [style.AFTER if (c.effect, c.element) in guilty else style.BEFORE for c in shown]
    with style.house_style():
        figure = _bars(
            [c.label for c in shown],
            [c.probability for c in shown],
            colours,
            [chance(c.probability) for c in shown],
        )
        axes = figure.axes[0]
        axes.set_xlim(0.0, 1.14)
        axes.set_xticks([0.0, 0.5, 1.0], ["0", "50 %", "100 %"])
        axes.set_xlabel("probability that it is at work")
        return figure


def ranked(verdict: Verdict) -> tuple[Cause, ...]:
    """The causes, then the other candidates that are worth a bar, most probable first."""
    guilty = {(c.effect, c.element) for c in verdict.causes}
    others = [c for c in verdict.candidates if (c.effect, c.element) not in guilty]
    others.sort(key=lambda cause: -cause.probability)
    likely = sum(cause.probability >= LIKELY for cause in others)
    causes = sorted(verdict.causes, key=lambda cause: -cause.probability)
    return (*causes, *others[: min(max(likely, FEWEST_RIVALS), MOST_RIVALS)])


def staircase(verdict: Verdict) -> Figure:
    """The held-out gap as the causes go in one by one, with the noise floor."""
    gap = verdict.gap
    factor, unit = scaled(gap.unit)
    steps = _from_the_top(_fewer(verdict.staircase), verdict)
    sizes = [factor * step.gap for step in steps]
    labels = [steps[0].label, *(f"+ {step.label}" for step in steps[1:])]
    colours = [style.BEFORE] + [style.AFTER] * (len(steps) - 1)
    floor = factor * gap.noise_floor
    with style.house_style():
        figure = _bars(labels, sizes, colours, [significant(size) for size in sizes], clear=floor)
        axes = figure.axes[0]
        axes.set_xlim(0.0, 1.16 * np.nanmax([*sizes, floor]) or 1.0)
        axes.xaxis.set_major_locator(MaxNLocator(6))
        axes.set_xlabel(f"root mean square of rows left out [{unit}]")
        if np.isfinite(floor):
            axes.axvline(floor, color=style.FLOOR, linewidth=1.6, linestyle=(0, (4, 2)))
            axes.annotate(
                f"{floor_words(verdict)} {significant(floor)}", (floor, 1.0),
                va="bottom", color=style.FLOOR,
                xycoords=("data", "axes fraction"), xytext=(4, 2), textcoords="offset points",
                fontsize=8.5,
            )  # fmt: skip
        return figure


def _from_the_top(steps: Sequence[Step], verdict: Verdict) -> list[Step]:
    """The steps, led by the gap before any cause unless the first of them is just that."""
    if steps and steps[0].label not in {cause.label for cause in verdict.causes}:
        return list(steps)
    return [Step("no cause", verdict.gap.before), *steps]


def _fewer(steps: Sequence[Step]) -> list[Step]:
    """All steps where they are few, else the first ones and the last."""
    if len(steps) <= MOST_BARS:
        return list(steps)
    between = len(steps) - MOST_BARS
    last = Step(f"{between + 1} more, last {steps[-1].label}", steps[-1].gap)
    return [*steps[: MOST_BARS - 1], last]


def shares(verdict: Verdict) -> Figure:
    """Share of the explained gap by stage and element, in the colours of the arm's picture."""
    where = verdict.where[:MOST_BARS]
    largest = max((place.share for place in where), default=1.0)
    with style.house_style():
        figure = _bars(
            [place_words(place.stage, place.element) for place in where],
            [place.share for place in where],
            [style.SHARES(max(place.share, 0.0) / largest) for place in where],
            [percent(place.share) for place in where],
            width=3.3,
        )
        axes = figure.axes[0]
        axes.set_xlim(0.0, 1.3 * largest)
        axes.xaxis.set_visible(False)
        axes.spines["bottom"].set_visible(False)
        return figure


def _bars(
    labels: Sequence[str],
    values: Sequence[float],
    colours: Sequence[object],
    words: Sequence[str],
    *,
    width: float = WIDTH,
    clear: float = np.nan,
) -> Figure:
    """Horizontal bars from the top down, each with its value in words, off the line ``clear``."""
    figure = style.new_figure(width, 0.75 + ROW * max(len(labels), 2))
    axes = figure.add_subplot()
    rows = np.arange(len(labels))
    lengths = np.nan_to_num(np.asarray(values, dtype=float))
    axes.barh(rows, lengths, height=0.62, color=list(colours))
    room = 0.13 * lengths.max(initial=0.0)
    for row, length, text in zip(rows, lengths, words, strict=True):
        end = clear if length <= clear < length + room else length
        axes.annotate(
            text, (end, row), xytext=(5, 0), textcoords="offset points", va="center",
            color=style.INK, fontsize=8.5,
        )  # fmt: skip
    short = [la if len(la) <= LONGEST else f"{la[: LONGEST - 1]}…" for la in labels]
    axes.set_yticks(rows, short, color=style.INK)
    axes.set_ylim(max(len(labels), 2) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    style.calm(axes, grid="")
    return figure


def with_curves(verdict: Verdict) -> tuple[Cause, ...]:
    """The causes that are curves, the largest first."""
    found = [(max(map(abs, c.curve.value)), c) for c in verdict.causes if c.curve is not None]
    return tuple(c for _, c in sorted(found, key=lambda pair: -pair[0])[:MOST_CURVES])


def curves(causes: tuple[Cause, ...]) -> Figure:
    """One row a cause: its error [mrad] over the joint's angle [rad], and the band."""
    with house_style():
        figure = new_figure(WIDTH, 0.5 + HEIGHT * len(causes))
        rows = figure.subplots(len(causes), 1, squeeze=False)[:, 0]
        for axes, cause in zip(rows, causes, strict=True):
            assert cause.curve is not None
            angle, value, std = map(
                np.array, (cause.curve.angle, cause.curve.value, cause.curve.std)
            )
            low, high = (MRAD * (value + side * 2.0 * std) for side in (-1.0, 1.0))
            axes.fill_between(angle, low, high, color=AFTER, alpha=0.25, linewidth=0)
            axes.plot(angle, MRAD * value, color=INK, linewidth=1.0)
            axes.set_title(cause.label, loc="left")
            axes.set_ylabel("mrad")
            calm(axes)
        rows[-1].set_xlabel("joint's reading [rad]")
        return figure

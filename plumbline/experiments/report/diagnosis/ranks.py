"""Where true values of simulated cases rank among what was stated of them, with their band."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binom

from plumbline.experiments.report.page.page import Picture
from plumbline.experiments.report.style import AFTER, FLOOR, calm, house_style, new_figure, says

BAND = (0.025, 0.975)  # of the count of a tenth if ranks are even: 95 %
WIDTH, HEIGHT = 5.2, 2.2  # [in]


def band(counts: Sequence[int]) -> tuple[int, int]:
    """Between which the count of one tenth lies in 95 % if all are alike likely."""
    low, high = (int(binom.ppf(p, sum(counts), 1.0 / len(counts))) for p in BAND)
    return low, high


def picture(counts: Sequence[int]) -> Picture:
    """The counts as bars: even ones say that stated errors are right."""
    low, high = band(counts)
    outside = sum(not low <= count <= high for count in counts)
    return Picture(
        "ranks",
        f"True values by tenths of what was stated: {outside} of {len(counts)} outside of the band",
        "How often a simulated case's true value lay in each tenth of what was stated of it. Even "
        "bars say that stated errors are right; high ends, that they are too small; a high middle, "
        "that they are too large.",
        (histogram(counts),),
        wide=True,
    )


def histogram(counts: Sequence[int]) -> Figure:
    """Bars of the tenths, with the 95 % band of even ones."""
    low, high = band(counts)
    with house_style():
        figure = new_figure(WIDTH, HEIGHT)
        axes = calm(figure.subplots())
        axes.axhspan(low, high, color=FLOOR, alpha=0.2, linewidth=0.0)
        bars = axes.bar(np.arange(len(counts)) + 0.5, counts, 0.86, color=AFTER)
        for k, (bar, count) in enumerate(zip(bars, counts, strict=True)):
            says(bar, f"{10 * k} to {10 * (k + 1)} %: {count}")
        axes.annotate(
            "95 % of even counts", (1.01, (low + high) / 2), xycoords=("axes fraction", "data"),
            va="center", color=FLOOR, fontsize=8.5, annotation_clip=False,
        )  # fmt: skip
        axes.set(xlim=(0, len(counts)), xlabel="tenth of what was stated", ylabel="true values")
    return figure

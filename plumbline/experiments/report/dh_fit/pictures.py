"""Pictures of a link fit: where it errs, what it cannot tell apart, which poses tell most."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from plumbline.experiments.report import style
from plumbline.optim.core.problem import Array
from plumbline.optim.dh_fit import DHFit
from plumbline.optim.dh_fit.local import LocalGlobal, Space
from plumbline.optim.dh_fit.poses import PoseDesign
from plumbline.optim.recording.constants import FIRST_ROW

SIGNED = LinearSegmentedColormap.from_list("signed", [style.AFTER, "#f4f4f2", style.GUILTY])
BRIGHTEST = 98.0  # percentile that the colours reach
TITLES = ("nominal links", "fitted in the box", "fitted everywhere")


def error_map(found: LocalGlobal, space: Space, axes: tuple[int, int] = (0, 2)) -> Figure:
    """Misfits of rows that no fit has seen, where the tip was, by what was fitted."""
    sizes = [
        1e3 * np.linalg.norm(values, axis=1)
        for values in (found.nominal, found.local, found.everywhere)
    ]
    with style.drawing(9.6, 3.6, 1, 3, sharex=True, sharey=True) as (figure, panels):
        fitted = Normalize(0.0, float(np.percentile(np.concatenate(sizes[1:]), BRIGHTEST)))
        before = Normalize(0.0, float(np.percentile(sizes[0], BRIGHTEST)))
        pairs = zip(panels, sizes, TITLES, (before, fitted, fitted), strict=True)
        for panel, values, title, scale in pairs:
            _cloud(panel, found.tips, values, scale, axes)
            _box(panel, space, axes)
            inside, outside = values[found.inside].mean(), values[~found.inside].mean()
            means = f"mean {inside:.3f} mm inside, {outside:.3f} outside"
            panel.set_title(f"{title}\n{means}", fontsize=8.5)
            panel.set_xlabel(f"{'xyz'[axes[0]]} [m], base frame")
        panels[0].set_ylabel(f"{'xyz'[axes[1]]} [m]")
        for scale, panel in ((before, panels[0]), (fitted, panels[2])):
            bar = figure.colorbar(ScalarMappable(scale, style.SIZES), ax=panel, shrink=0.85)
            bar.outline.set_visible(False)
            bar.set_label("misfit [mm]; larger ones in the last colour")
        return figure


def _cloud(
    panel: Axes, tips: Array, values: Array, scale: Normalize, axes: tuple[int, int]
) -> None:
    order = np.argsort(values, kind="stable")
    x, y = tips[order, axes[0]], tips[order, axes[1]]
    panel.scatter(x, y, c=values[order], cmap=style.SIZES, norm=scale, s=9, linewidths=0)
    panel.set_aspect("equal", adjustable="box")
    style.calm(panel, grid="both")


def _box(panel: Axes, space: Space, axes: tuple[int, int]) -> None:
    corner = tuple(float(space.lower[k]) for k in axes)
    width, height = (float(space.upper[k] - space.lower[k]) for k in axes)
    panel.add_patch(
        Rectangle((corner[0], corner[1]), width, height, fill=False, edgecolor=style.INK)
    )


def correlations(fit: DHFit) -> Figure:
    """Correlations of the estimates: red and blue pairs are hardly told apart by these poses."""
    known = np.isfinite(fit.std)
    names = [name for name, k in zip(fit.statement.names, known, strict=True) if k]
    C = fit.correlations[np.ix_(known, known)]
    size = 1.8 + 0.19 * len(names)
    with style.drawing(size + 0.7, size) as (figure, axes):
        drawn = axes.imshow(C, cmap=SIGNED, vmin=-1.0, vmax=1.0)
        places = list(range(len(names)))
        axes.set_xticks(places, names, rotation=90, fontsize=7.5)
        axes.set_yticks(places, names, fontsize=7.5)
        axes.tick_params(length=0)
        for side in axes.spines.values():
            side.set_visible(False)
        bar = figure.colorbar(drawn, ax=axes, shrink=0.7)
        bar.outline.set_visible(False)
        bar.set_label("correlation of two estimates")
        return figure


def rows_picture(fit: DHFit) -> Figure:
    """Misfits of all rows before and after [mm], by row as an editor counts."""
    numbers = np.arange(len(fit.readings)) + FIRST_ROW
    with style.drawing(4.6, 3.6) as (figure, axes):
        for values, colour, label in (
            (fit.nominal_misfits(), style.BEFORE, "nominal"),
            (fit.misfits(), style.AFTER, "fitted"),
        ):
            sizes = 1e3 * np.linalg.norm(values, axis=1)
            many = len(sizes) > style.MOST_VECTORS
            dots = axes.scatter(numbers, sizes, s=12, color=colour, alpha=0.75, linewidths=0,
                                label=label, rasterized=many)  # fmt: skip
            if not many:
                style.numbered(dots, numbers)
        axes.set(xlabel="row of samples.csv", ylabel="misfit [mm]", ylim=(0.0, None))
        axes.legend(loc="upper right")
        style.calm(axes)
        return figure


def designs(chosen: Sequence[tuple[str, PoseDesign]], blind: Sequence[PoseDesign]) -> Figure:
    """What designs promise: how well links are known, and the worst expected target error."""
    with style.drawing(5.4, 3.2) as (figure, axes):
        x = [d.log_determinant for d in blind]
        y = [1e3 * d.worst for d in blind]
        axes.scatter(
            x, y, color=style.BEFORE, s=16, linewidths=0, label=f"{len(blind)} random designs"
        )
        for (name, design), colour in zip(chosen, (style.AFTER, style.GUILTY), strict=False):
            place = (design.log_determinant, 1e3 * design.worst)
            axes.scatter(*place, color=colour, s=46, linewidths=0, label=name, zorder=3)
        axes.set(
            ylim=(0.0, None),
            xlabel="log det of the information: more is better",
            ylabel="worst expected target error [mm]",
        )
        axes.legend(loc="upper right")
        style.calm(axes)
        return figure

"""Markers, errors and needles in pictures: what a registration is worth, and where it leads.

Coordinates are drawn in mm, in the frame that an axis names.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from plumbline.experiments.report import style
from plumbline.experiments.report.pointing.figures import box_edges
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing import Box
from plumbline.optim.registration import Registration, TargetError

MM = 1e3  # [mm/m]
VIEWS = ((0, 1), (0, 2))  # axes across and up: from above, from the side


def two_frames(
    markers: Mapping[str, Array], lesions: Mapping[str, Array], body: Box, T_RC: Array
) -> Figure:
    """The same markers in CT and in robot coordinates, each from above and from the side."""
    with style.drawing(7.2, 6.4, 2, 2) as (figure, axes):
        frames = (("CT", np.eye(4)), ("robot", T_RC))
        for column, (name, T) in enumerate(frames):
            for row, (a, b) in enumerate(VIEWS):
                ax = axes[row, column]
                for edge in box_edges(body):
                    ends = MM * _moved(T, edge)
                    ax.plot(ends[:, a], ends[:, b], color=style.FAINT, linewidth=1.0, zorder=1)
                _named(ax, {k: _moved(T, p) for k, p in markers.items()}, (a, b), style.AFTER, "o")
                _named(ax, {k: _moved(T, p) for k, p in lesions.items()}, (a, b), style.GUILTY, "D")
                _arrows(ax, T, (a, b), 0.04)
                _labelled(ax, a, b, name)
        axes[0, 0].plot([], [], "o", color=style.AFTER, label="marker")
        axes[0, 0].plot([], [], "D", color=style.GUILTY, markersize=5, label="lesion")
        axes[0, 0].plot([], [], "-", color=style.INK, label="CT's axes")
        figure.legend(loc="outside upper center", ncols=3)
        return figure


def error_regions(
    cases: Mapping[str, tuple[TargetError, Array]], views: Sequence[tuple[int, int]] = VIEWS
) -> Figure:
    """Draws' errors (N, 3) [m] of targets and the 95 % ellipsoids, by case and view."""
    with style.house_style():
        figure = style.new_figure(2.5 * len(cases), 2.6 * len(views))
        axes = np.atleast_2d(figure.subplots(len(views), len(cases)))
        for column, (name, (region, errors)) in enumerate(cases.items()):
            inside = float(region.holds(errors).mean())
            widest = float(np.quantile(np.abs(errors), 0.999))
            half = MM * 1.15 * max(widest, 0.0 if region.unknown else region.semi_axes()[0])
            for row, (a, b) in enumerate(views):
                ax = axes[row, column]
                points = MM * errors[:1500]
                ax.scatter(
                    points[:, a], points[:, b], s=3, color=style.BEFORE, linewidths=0, alpha=0.6,
                    rasterized=True,
                )  # fmt: skip
                if not region.unknown:
                    ax.add_patch(_shadow(region, a, b))
                ax.plot(0, 0, "+", color=style.INK, markersize=8)
                ax.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
                ax.set_xlabel(f"robot {'xyz'[a]} error [mm]")
                ax.set_ylabel(f"robot {'xyz'[b]} error [mm]")
                style.calm(ax, grid="both")
            axes[0, column].set_title(f"{name}\n{100 * inside:.1f} % inside, in space")
        first = axes[0, 0]
        first.plot([], [], ".", color=style.BEFORE, label="draws")
        first.plot([], [], "-", color=style.GUILTY, label="shadow of the predicted 95 % ellipsoid")
        figure.legend(*first.get_legend_handles_labels(), loc="outside lower center", ncols=2)
        return figure


def misfits_and_targets(answer: Registration) -> Figure:
    """How far each marker is from where the transform puts it, and how far targets may be [mm]."""
    recording, used = answer.recording, set(answer.used)
    errors = [answer.tre(place, None) for place in recording.targets.ct]
    names = [*answer.labels, *recording.targets.labels]
    with style.drawing(6.4, 0.3 * (len(answer.labels) + len(errors)) + 1.4) as (figure, axes):
        for k, misfit in enumerate(MM * answer.misfits):
            ink = style.AFTER if k in used else style.PAPER
            (bar,) = axes.barh(k, misfit, color=ink, edgecolor=style.AFTER, height=0.6)
            style.says(bar, f"{names[k]}: {misfit:.3g} mm")
        for k, error in enumerate(errors, start=len(answer.labels)):
            if error.unknown:
                axes.text(0.0, k, " not known", va="center", color=style.MUTED)
                continue
            rms, reach = MM * error.rms, MM * error.reach
            (bar,) = axes.barh(k, rms, color=style.GUILTY, edgecolor=style.GUILTY, height=0.6)
            style.says(bar, f"{names[k]}: {rms:.3g} mm RMS, {reach:.3g} mm at most")
            axes.plot([0.0, reach], [k, k], "|-", color=style.INK, markersize=9)
        for label, ink, edge, there in (
            ("misfit of a marker used", style.AFTER, style.AFTER, True),
            ("misfit of one not used", style.PAPER, style.AFTER, len(used) < len(answer.labels)),
            ("predicted RMS error of a target", style.GUILTY, style.GUILTY, len(errors) > 0),
        ):
            axes.barh(0, 0, color=ink, edgecolor=edge, label=label if there else None)
        if errors:
            axes.plot([], [], "|-", color=style.INK, label="95 of 100 such targets are nearer")
        axes.set_yticks(range(len(names)), labels=names)
        axes.invert_yaxis()
        axes.set_xlabel("mm")
        style.calm(axes, grid="x")
        figure.legend(loc="outside lower center", ncols=2)
        return figure


def _shadow(region: TargetError, a: int, b: int) -> Ellipse:
    """What a light along the third axis makes of the 95 % ellipsoid."""
    part = region.covariance[np.ix_([a, b], [a, b])]
    values, vectors = np.linalg.eigh(part)
    width, height = 2 * MM * np.sqrt(region.limit() * values)
    angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
    middle = MM * region.mean[[a, b]]
    return Ellipse(
        (float(middle[0]), float(middle[1])), float(width), float(height), angle=angle,
        fill=False, edgecolor=style.GUILTY, linewidth=1.8,
    )  # fmt: skip


def error_maps(
    answers: Mapping[str, Registration], markers: Mapping[str, Array], lesion: Array, body: Box
) -> Figure:
    """Predicted RMS error over the slice of CT through a lesion, square to x: one panel a set."""
    low, high = np.asarray(body.lower), np.asarray(body.upper)
    y, z = (np.linspace(low[k], high[k], 60) for k in (1, 2))
    grid = np.stack(np.broadcast_arrays(lesion[0], y[None, :], z[:, None]), axis=-1)
    maps = {name: MM * answer.tre_rms(grid) for name, answer in answers.items()}
    least = min(float(m.min()) for m in maps.values())
    most = max(float(m.max()) for m in maps.values())
    scale = LogNorm(least, most)
    with style.house_style():
        figure = style.new_figure(2.6 * len(maps) + 0.5, 3.3)
        axes = np.atleast_1d(figure.subplots(1, len(maps), sharey=True))
        extent = (MM * low[1], MM * high[1], MM * low[2], MM * high[2])
        for ax, (name, found) in zip(axes, maps.items(), strict=True):
            ax.imshow(
                found, origin="lower", extent=extent, cmap=style.SIZES, norm=scale, aspect="equal"
            )
            lines = ax.contour(
                MM * y, MM * z, found, levels=_levels(found), colors=style.INK, linewidths=0.7
            )
            ax.clabel(lines, fmt="%.3g mm", fontsize=7.5)
            for k, (label, p) in enumerate(markers.items()):
                rests, inside = k in answers[name].used, p[1] <= low[1]
                ax.plot(
                    MM * p[1], MM * p[2], "o", color=style.INK if rests else style.PAPER, zorder=5,
                    mec=style.PAPER if rests else style.INK, markersize=6.5, clip_on=False,
                )  # fmt: skip
                shift, ink = ((8, -3), style.PAPER) if inside else ((0, 7), style.INK)
                _tag(ax, label, (MM * p[1], MM * p[2]), shift, ink)
            ax.plot(MM * lesion[1], MM * lesion[2], "D", color=style.GUILTY, markersize=5)
            ax.set_title(name, pad=18)
            ax.set_xlabel("CT y [mm]")
        axes[0].set_ylabel("CT z [mm]")
        used, not_used = (style.INK, style.PAPER), (style.PAPER, style.INK)
        axes[0].plot([], [], "o", color=used[0], mec=used[1], label="marker used")
        axes[0].plot([], [], "o", color=not_used[0], mec=not_used[1], label="marker not used")
        axes[0].plot([], [], "D", color=style.GUILTY, markersize=5, label="lesion")
        figure.legend(loc="outside lower center", ncols=3)
        bar = figure.colorbar(
            ScalarMappable(scale, style.SIZES), ax=list(axes), shrink=0.85, pad=0.02
        )
        bar.set_label("predicted RMS error [mm]")
        ticks = [t for t in (0.5, 1, 2, 3, 5, 10, 20, 50) if least <= t <= most]
        bar.set_ticks(ticks, labels=[f"{t:g}" for t in ticks])
        bar.minorticks_off()
        return figure


def _levels(values: Array) -> list[float]:
    low, high = float(values.min()), float(values.max())
    steps = [0.5, 0.6, 0.8, 1, 1.25, 1.5, 2, 2.5, 3, 4, 6, 8, 10, 12, 15, 20, 25, 30, 40]
    inside = [s for s in steps if low < s < high]
    return inside[:: max(1, len(inside) // 4)] or [(low + high) / 2]


def _moved(T: Array, points: Array) -> Array:
    moved: Array = points @ T[:3, :3].T + T[:3, 3]
    return moved


def _named(
    axes: Axes, points: Mapping[str, Array], view: tuple[int, int], colour: str, shape: str
) -> None:
    """Points with their names; those that hide one another share a label."""
    a, b = view
    places: dict[tuple[float, float], list[str]] = {}
    for name, p in points.items():
        axes.plot(MM * p[a], MM * p[b], shape, color=colour, markersize=5.5, zorder=3)
        spot = (round(float(MM * p[a]), 1), round(float(MM * p[b]), 1))
        places.setdefault(spot, []).append(name)
    for k, (spot, names) in enumerate(places.items()):
        # Diamonds crowd: their names go left and right in turn.
        beside = (8, -3) if k % 2 else (-8, -3)
        _tag(axes, ", ".join(names), spot, beside if shape == "D" else (6, 4), colour)


def _tag(
    axes: Axes,
    text: str,
    place: tuple[float, float],
    shift: tuple[int, int],
    colour: str = style.INK,
) -> None:
    axes.annotate(
        text, place, xytext=shift, textcoords="offset points", color=colour, fontsize=8.5,
        fontweight="bold", ha=("right", "center", "left")[1 + int(np.sign(shift[0]))], zorder=6,
    )  # fmt: skip


def _arrows(axes: Axes, T: Array, view: tuple[int, int], length: float) -> None:
    """The CT's axes from its origin, those that this view shows."""
    a, b = view
    for k in range(3):
        tip = T[:3, 3] + length * T[:3, k]
        across = MM * np.array([tip[a] - T[a, 3], tip[b] - T[b, 3]])
        if np.linalg.norm(across) < 1.0:
            continue
        start = (MM * T[a, 3], MM * T[b, 3])
        axes.annotate(
            "", (start[0] + across[0], start[1] + across[1]), start,
            arrowprops={"arrowstyle": "-|>", "color": style.INK, "linewidth": 1.2}, zorder=4,
        )  # fmt: skip
        axes.annotate(
            "xyz"[k], (start[0] + 1.25 * across[0], start[1] + 1.25 * across[1]), ha="center",
            va="bottom" if k == 0 else "top" if k == 1 else "center", fontsize=8.5, zorder=4,
            style="italic",
        )  # fmt: skip


def _labelled(axes: Axes, a: int, b: int, frame: str) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=f"{frame} {'xyz'[a]} [mm]", ylabel=f"{frame} {'xyz'[b]} [mm]")
    axes.margins(0.12)
    style.calm(axes, grid="both")

"""Needles in pictures: which angles are safe, the cone about the lesion, the path of the joints."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from plumbline.experiments.report import style
from plumbline.experiments.report.diagnosis.arm import project
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing import AngleMap, Status, Sweep
from plumbline.optim.pointing.body import Box
from plumbline.optim.pointing.task import links

MM = 1e3  # [mm/m]
COLOURS = {
    Status.SAFE: "#009e73",
    Status.REACH: "#d3d6da",
    Status.LIMIT: "#8a9099",
    Status.SINGULAR: "#f0e442",
    Status.COLLISION: "#d55e00",
    Status.INSIDE: "#cc79a7",
    Status.JUMP: "#56b4e9",
    Status.BLOCKED: "#7f2a00",
}
JOINTS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#4d4d4d")
STYLES = ("-", "--", "-.", ":")


def angle_map(found: AngleMap) -> Figure:
    """One map over theta (outwards) and beta (around)."""
    return safe_angles([(f"arm of {found.aim.chain.n} joints", found)])


def safe_angles(
    maps: Sequence[tuple[str, AngleMap]], mark: tuple[float, float] | None = None
) -> Figure:
    """Maps over theta (outwards) and beta (around), one an arm; ``mark`` is one angle [rad]."""
    with style.house_style():
        figure = style.new_figure(3.6 * len(maps), 4.2)
        shown: dict[Status, str] = {}
        for k, (name, found) in enumerate(maps):
            axes = figure.add_subplot(1, len(maps), k + 1, projection="polar")
            _rings(axes, found)
            if mark is not None:
                axes.plot(
                    mark[1], np.degrees(mark[0]), "*", color=style.PAPER, markeredgecolor=style.INK,
                    markersize=11, label="published angle",
                )  # fmt: skip
            axes.set_title(f"{name}\n", loc="center")
            shown |= {kind: COLOURS[kind] for kind, _ in found.counts()}
        handles = [Patch(color=c, label=kind.value) for kind, c in COLOURS.items() if kind in shown]
        stars = figure.axes[0].get_legend_handles_labels()[0]
        figure.legend(handles=[*handles, *stars], loc="outside lower center", ncols=3)
        return figure


def _rings(axes: Axes, found: AngleMap) -> None:
    theta, beta = np.degrees(found.theta), found.beta
    kinds = list(COLOURS)
    number = np.vectorize(kinds.index)(found.status)
    colours = np.array([COLOURS[kind] for kind in kinds])[number]
    inner = np.concatenate(
        [[max(0.0, 1.5 * theta[0] - 0.5 * theta[1])], (theta[1:] + theta[:-1]) / 2]
    )
    outer = np.append(inner[1:], 1.5 * theta[-1] - 0.5 * theta[-2])
    width = float(beta[1] - beta[0])
    for i in range(len(theta)):
        axes.bar(
            beta, outer[i] - inner[i], width=width, bottom=inner[i], color=colours[i],
            edgecolor=style.PAPER, linewidth=0.3,
        )  # fmt: skip
    axes.set_ylim(0.0, float(outer[-1]))
    axes.tick_params(axis="x", pad=7)
    around(axes)


def around(axes: Axes) -> None:
    """Polar axes that say theta outwards and beta around."""
    axes.set_yticks([20, 40, 60], labels=["20°", "40°", "θ = 60°"])
    for label in axes.get_yticklabels():
        label.set_color(style.INK)
    axes.set_xticks(np.deg2rad([0, 90, 180, 270]), labels=["β = 0°", "90°", "180°", "270°"])
    axes.grid(visible=False)
    axes.spines["polar"].set_visible(False)


def cone(sweep: Sweep, azimuth: float, shown: int = 4) -> Figure:
    """The arm at some angles of a sweep, the needle at all, the body; orthographic, mm."""
    held = np.flatnonzero(np.isfinite(sweep.joints).all(axis=1))
    tips, tops = sweep.tips_and_tops
    with style.drawing(6.4, 5.2) as (figure, axes):
        _floor(axes, azimuth)
        if isinstance(sweep.aim.body, Box):
            _solid(axes, sweep.aim.T_robot_ct, sweep.aim.body, azimuth)
        for tip, top in zip(tips[held], tops[held], strict=True):
            line = MM * project(np.array([tip, top]), azimuth)
            axes.plot(*line.T, color=style.FLOOR, linewidth=0.8, alpha=0.45)
            way = MM * project(np.array([sweep.aim.target, tip]), azimuth)
            axes.plot(*way.T, color=style.FLOOR, linewidth=0.6, alpha=0.35, linestyle=":")
        for k, i in enumerate(held[np.linspace(0, len(held) - 1, shown).round().astype(int)]):
            _arm(axes, sweep, int(i), azimuth, 0.35 + 0.65 * k / max(shown - 1, 1))
        axes.plot(
            *(MM * project(sweep.aim.target[None], azimuth)).T, "D", color=style.GUILTY, zorder=6,
            label="lesion, tool centre point", linestyle="none", markersize=7,
        )  # fmt: skip
        axes.plot([], [], color=style.FLOOR, label="needle, one line an angle")
        axes.plot([], [], ":", color=style.FLOOR, label="from its tip to the lesion")
        axes.plot(
            [], [], color=style.AFTER, linewidth=5, label=f"arm, {shown} of {len(held)} postures"
        )
        axes.plot([], [], color=style.MUTED, linewidth=1, label="body; base")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set(xlabel="across the line of sight [mm]", ylabel="upwards in the picture [mm]")
        axes.margins(0.05)
        style.calm(axes, grid="both")
        figure.legend(loc="outside lower center", ncols=3)
        return figure


def _arm(axes: Axes, sweep: Sweep, k: int, azimuth: float, strength: float) -> None:
    segments = links(sweep.aim.chain, sweep.joints[k : k + 1])[0]
    path = MM * project(np.vstack([segments[:, 0], segments[-1:, 1]]), azimuth)
    axes.plot(
        *path.T, color=style.AFTER, linewidth=5, alpha=strength, solid_joinstyle="round", zorder=3
    )
    joints = MM * project(segments[1::2, 0], azimuth)
    axes.plot(*joints.T, "o", color=style.PAPER, markersize=3.2, zorder=4, alpha=strength)


def _solid(axes: Axes, T: Array, body: Box, azimuth: float) -> None:
    for edge in box_edges(body):
        flat = MM * project(edge @ T[:3, :3].T + T[:3, 3], azimuth)
        axes.plot(*flat.T, color=style.MUTED, linewidth=1.0, zorder=2)


def box_edges(body: Box) -> list[Array]:
    """The twelve edges of a box, the ends (2, 3) [m] of each."""
    low, high = np.asarray(body.lower), np.asarray(body.upper)
    share = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    corners = low + share * (high - low)
    return [corners[[i, i | bit]] for i in range(8) for bit in (1, 2, 4) if not i & bit]


def _floor(axes: Axes, azimuth: float) -> None:
    turn = np.linspace(0.0, 2 * np.pi, 80)
    disc = 0.07 * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    axes.fill(
        *(MM * project(disc, azimuth)).T, facecolor=style.FAINT, edgecolor=style.MUTED, zorder=1
    )


def joint_path(sweep: Sweep) -> Figure:
    """The joints over a sweep, and what Pinocchio and coal say of it."""
    beta = np.degrees(sweep.beta)
    turning = np.array(sweep.aim.chain.kinds) == "revolute"
    with style.house_style():
        figure = style.new_figure(6.8, 6.2)
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=[2.2, 1, 1])
        for j in range(sweep.aim.chain.n):
            factor = 180 / np.pi if turning[j] else MM
            top.plot(
                beta, factor * sweep.joints[:, j], color=JOINTS[j % 7], linestyle=STYLES[j % 4],
                linewidth=1.7, label=f"joint {j + 1}",
            )  # fmt: skip
        top.set_ylabel("joint [deg]" if turning.all() else "joint [deg or mm]")
        top.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        middle.plot(beta, sweep.singular_value, color=style.AFTER, linewidth=1.7)
        middle.set(ylabel="smallest singular\nvalue [rad/rad]", ylim=(0.0, None))
        bottom.plot(beta, MM * sweep.clearance, color=style.GUILTY, linewidth=1.7)
        bottom.set(
            ylabel="clearance\n[mm]",
            ylim=(0.0, None),
            xlabel="azimuth β from the CT's x axis [deg]",
        )
        for ax in (top, middle, bottom):
            style.calm(ax, grid="both")
        off = sweep.rcm_error[np.isfinite(sweep.rcm_error)]
        said = f"at most {MM * off.max():.0e} mm off the lesion" if len(off) else "held nowhere"
        top.set_title(
            f"θ = {np.degrees(sweep.theta[0]):.0f}°, {len(sweep)} angles; tool centre point {said}"
        )
        return figure

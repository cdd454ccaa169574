"""Residuals before and after: over the workspace, each joint, time, and against the noise.

Every function takes a :class:`~plumbline.experiments.report.diagnosis.subject.Subject` and returns
figures of one panel or two, so that a page can set them side by side or, on a phone, one below the
other.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from plumbline.experiments.report import style
from plumbline.experiments.report.diagnosis.subject import Subject, running
from plumbline.optim.core.problem import Array

PANEL = (3.3, 2.6)  # [in]
WIDE_FIGURE = 5.2  # [in]
VIEWS = ((0, 1, "from above"), (0, 2, "from the front"), (1, 2, "from the side"))
TIMES = ((120.0, 1.0, "s"), (7200.0, 60.0, "min"), (np.inf, 3600.0, "h"))
LARGEST = 99.5  # percentile that an axis reaches: a few gross rows shall not hide the rest
BRIGHTEST = 98.0  # percentile that the colours reach


def workspace(subject: Subject) -> tuple[Figure, ...]:
    """Size of the residuals where the tip was, before and after, in three projections; a scale."""
    scale = Normalize(0.0, top_of(subject.sizes[0], BRIGHTEST))
    with style.house_style():
        views = [_view(subject, view, scale) for view in VIEWS]
        return (*views, _colour_scale(scale, subject.unit))


def _view(subject: Subject, view: tuple[int, int, str], scale: Normalize) -> Figure:
    a, b, seen = view
    figure = style.new_figure(3.3, 4.9)
    axes = figure.subplots(2, 1)
    for ax, sizes, when in zip(axes, subject.sizes, ("before", "after"), strict=True):
        # Large ones on top: they are what the picture is about.
        order = np.argsort(sizes, kind="stable")
        x, y = subject.places[order, a], subject.places[order, b]
        look = {"c": sizes[order], "cmap": style.SIZES, "norm": scale, "s": _dot(len(x), 1.6)}
        cloud(ax, x, y, subject.rows[order], **look)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(title=f"{when}, {seen}", ylabel=f"{'xyz'[b]} [m]")
        ax.xaxis.set_major_locator(MaxNLocator(4))
        ax.yaxis.set_major_locator(MaxNLocator(5))
        style.calm(ax, grid="both")
    axes[1].set_xlabel(f"{'xyz'[a]} [m], {'CT' if subject.touches else 'base frame'}")
    return figure


def _colour_scale(scale: Normalize, unit: str) -> Figure:
    figure = style.new_figure(WIDE_FIGURE, 0.62)
    bar = figure.add_subplot()
    drawn = figure.colorbar(ScalarMappable(scale, style.SIZES), cax=bar, orientation="horizontal")
    drawn.outline.set_visible(False)
    if drawn.solids is not None:
        drawn.solids.set_edgecolor("face")
    bar.set_xlabel(f"from the predicted to the measured tip [{unit}]; larger: last colour")
    return figure


def over_joints(subject: Subject) -> tuple[Figure, ...]:
    """Residuals over each joint's reading; of an encoder, over its own joint's reading."""
    joints = (
        tuple(subject.encoder_columns) if subject.encoders else range(subject.recording.chain.n)
    )
    q = subject.recording.q
    with style.house_style():
        return tuple(_panel(subject, j, q[:, j], "reading [{}]") for j in joints)


def over_velocity(subject: Subject) -> tuple[Figure, ...]:
    """Residuals of each encoder over its joint's velocity; none where that is not recorded."""
    velocity = subject.recording.velocity
    if velocity is None or not subject.encoders:
        return ()
    with style.house_style():
        return tuple(
            _panel(subject, j, velocity[:, j], "velocity [{}/s]") for j in subject.encoder_columns
        )


def _panel(subject: Subject, joint: int, x: Array, words: str) -> Figure:
    """Residuals over what a joint did, in rad or m; its axis is called by words with the unit."""
    turning = subject.recording.chain.kinds[joint] == "revolute"
    factor, unit = (180.0 / np.pi, "deg") if turning else (1e3, "mm")
    figure = style.new_figure(*PANEL)
    axes = figure.add_subplot()
    before, after = _values(subject, joint)
    drawn_pair(axes, factor * x, before, after, subject.rows, signed=subject.encoders)
    axes.set(title=f"joint {joint + 1}", xlabel=words.format(unit), ylabel=_residual_label(subject))
    return figure


def over_time(subject: Subject) -> tuple[Figure, ...]:
    """Size of the residuals over time; none where time is not recorded."""
    time = subject.recording.time
    if time is None:
        return ()
    since = time - time.min()
    divisor, unit = next((d, u) for end, d, u in TIMES if since.max() <= end)
    with style.drawing(WIDE_FIGURE, 2.5) as (figure, axes):
        drawn_pair(axes, since / divisor, *subject.sizes, subject.rows, signed=False)
        axes.set(
            xlabel=f"time since the first row [{unit}]",
            ylabel=_residual_label(subject, signed=False),
        )
        return (figure,)


def against_noise(subject: Subject) -> Figure:
    """Histograms of the single readings' residuals, with the density of the noise."""
    columns = list(subject.encoder_columns.values()) if subject.encoders else slice(None)
    before, after = (_finite(r[:, columns]) for r in (subject.before, subject.after))
    sigma = subject.factor * subject.verdict.noise.sigma
    half = max(top_of(np.abs(before)), top_of(np.abs(after)), 3.0 * np.nan_to_num(sigma))
    edges = np.linspace(-half, half, 61)
    with style.drawing(WIDE_FIGURE, 2.5) as (figure, axes):
        for values, colour, label in (
            (before, style.BEFORE, "before"),
            (after, style.AFTER, "after"),
        ):
            alpha = 0.55 if label == "before" else 0.75
            axes.hist(values, edges.tolist(), density=True, color=colour, alpha=alpha, label=label)
        if np.isfinite(sigma) and sigma > 0.0:
            x = np.linspace(-half, half, 601)
            density = np.exp(-0.5 * (x / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
            axes.plot(x, density, color=style.FLOOR, linewidth=1.6, label="noise alone")
        what = "joint's effort" if subject.torques else "second encoder"
        what = what if subject.encoders else "range" if subject.ranges else "axis"
        axes.set_xlabel(f"predicted - measured, one {what} [{subject.unit}]".replace("-", "−"))
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.legend(loc="upper right")
        return figure


def _values(subject: Subject, joint: int) -> tuple[Array, Array]:
    """What is drawn over a joint: sizes, or the residuals of the joint's own encoder."""
    if not subject.encoders:
        return subject.sizes
    column = subject.encoder_columns[joint]
    return subject.before[:, column], subject.after[:, column]


def _residual_label(subject: Subject, signed: bool | None = None) -> str:
    signed = subject.encoders if signed is None else signed
    return f"{'residual' if signed else 'size of residual'} [{subject.unit}]"


def drawn_pair(
    axes: Axes, x: Array, before: Array, after: Array, rows: NDArray[np.int64], *, signed: bool
) -> None:
    """Two clouds and their running means or, of sizes, medians; before in grey."""
    for y, colour, label in ((before, style.BEFORE, "before"), (after, style.AFTER, "after")):
        cloud(axes, x, y, rows, color=colour, s=_dot(len(x), 1.0), label=label)
        middle, median = running(x, y, np.mean if signed else np.median)
        if len(middle):
            # A pale edge keeps the line apart from its own cloud.
            axes.plot(middle, median, color=style.PAPER, linewidth=3.2, alpha=0.8)
            axes.plot(
                middle,
                median,
                color=style.MUTED if colour == style.BEFORE else colour,
                linewidth=1.8,
            )
    top = max(top_of(np.abs(before)), top_of(np.abs(after)))
    axes.set_ylim(-top if signed else 0.0, top)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    style.calm(axes)


def cloud(axes: Axes, x: Array, y: Array, rows: NDArray[np.int64], **look: Any) -> None:
    """Dots, of many rows as pixels, of few with the row's number."""
    many, good = len(x) > style.MOST_VECTORS, np.isfinite(x) & np.isfinite(y)
    look = {k: v[good] if isinstance(v, np.ndarray) else v for k, v in look.items()}
    points = axes.scatter(x[good], y[good], linewidths=0, alpha=0.75, rasterized=many, **look)
    if not many:
        style.numbered(points, rows[good])


def _dot(count: int, factor: float) -> float:
    """Area of a dot [pt^2]: the fewer, the larger."""
    return factor * float(np.clip(3000.0 / max(count, 1), 2.0, 14.0))


def _finite(values: Array) -> Array:
    flat = np.ravel(values)
    return flat[np.isfinite(flat)]


def top_of(values: Array, share: float = LARGEST) -> float:
    """Where a scale ends: nearly all values below it, with a little room."""
    found = _finite(values)
    top = 1.06 * float(np.percentile(found, share)) if len(found) else 0.0
    return top if top > 0.0 else 1.0

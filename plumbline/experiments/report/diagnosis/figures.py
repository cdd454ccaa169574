"""Residuals before and after: over the workspace, each joint, time, and against the noise.

Every function takes a :class:`~plumbline.experiments.report.diagnosis.subject.Subject` and returns
figures of one panel or two, so that a page can set them side by side or, on a phone, one below the
other.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
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
    words = f"from the predicted to the measured tip [{subject.unit}]; larger: last colour"
    with style.house_style():
        views = [_view(subject, view, scale) for view in VIEWS]
        return (*views, colour_scale(scale, style.SIZES, words))


def _view(subject: Subject, view: tuple[int, int, str], scale: Normalize) -> Figure:
    a, b, seen = view

    def drawn(axes: Axes, sizes: Array) -> None:
        # Large ones on top: they are what the picture is about.
        order = np.argsort(sizes, kind="stable")
        x, y = subject.places[order, a], subject.places[order, b]
        look = {"c": sizes[order], "cmap": style.SIZES, "norm": scale, "s": _dot(len(x), 1.6)}
        cloud(axes, x, y, subject.rows[order], **look)

    across = f"{'xyz'[a]} [m], {'CT' if subject.touches else 'base frame'}"
    return before_above_after(drawn, subject.sizes, f"{{}}, {seen}", across, f"{'xyz'[b]} [m]")


def before_above_after(
    draw: Callable[[Axes, Array], None],
    values: Sequence[Array],
    title: str,
    across: str,
    upwards: str,
) -> Figure:
    """Values before and after at their places, in two panels with equal axes, title and labels."""
    figure = style.new_figure(3.3, 4.9)
    panels = figure.subplots(2, 1)
    for axes, drawn, when in zip(panels, values, ("before", "after"), strict=True):
        draw(axes, drawn)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set(title=title.format(when), ylabel=upwards)
        axes.xaxis.set_major_locator(MaxNLocator(4))
        axes.yaxis.set_major_locator(MaxNLocator(5))
        style.calm(axes, grid="both")
    panels[1].set_xlabel(across)
    return figure


def colour_scale(scale: Normalize, colours: Colormap, words: str) -> Figure:
    """A scale of colours in a figure of its own, lying."""
    figure = style.new_figure(WIDE_FIGURE, 0.62)
    bar = figure.add_subplot()
    drawn = figure.colorbar(ScalarMappable(scale, colours), cax=bar, orientation="horizontal")
    drawn.outline.set_visible(False)
    if drawn.solids is not None:
        drawn.solids.set_edgecolor("face")
    bar.set_xlabel(words)
    return figure


def over_joints(subject: Subject) -> tuple[Figure, ...]:
    """Residuals over each joint's reading; of an encoder, over its own joint's reading."""
    q = subject.recording.q
    joints = subject.encoder_columns if subject.encoders else range(q.shape[1])
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
    labels = {"title": f"joint {joint + 1}", "xlabel": words.format(unit)}
    labels["ylabel"] = _residual_label(subject)
    pair = _values(subject, joint)
    return panel(factor * x, pair, subject.rows, signed=subject.encoders, **labels)


def panel(
    x: Array, pair: tuple[Array, Array], rows: NDArray[np.int64], *, signed: bool, **labels: str
) -> Figure:
    """Residuals (N,) before and after over what they may depend on (N,), with labels of axes."""
    figure = style.new_figure(*PANEL)
    axes = figure.add_subplot()
    drawn_pair(axes, x, *pair, rows, signed=signed)
    axes.set(**labels)
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
        axes.set_xlabel(f"time since the first row [{unit}]")
        axes.set_ylabel(_residual_label(subject, signed=False))
        return (figure,)


def against_noise(subject: Subject) -> Figure:
    """Histograms of the single readings' residuals, with the density of the noise."""
    columns = list(subject.encoder_columns.values()) if subject.encoders else slice(None)
    before, after = (_finite(r[:, columns]) for r in (subject.before, subject.after))
    sigma = subject.factor * subject.verdict.noise.sigma
    half = max(top_of(np.abs(before)), top_of(np.abs(after)), 3.0 * np.nan_to_num(sigma))
    edges = np.linspace(-half, half, 61)
    with style.drawing(WIDE_FIGURE, 2.5) as (figure, axes):
        look = {"bins": edges.tolist(), "density": True}
        axes.hist(before, color=style.BEFORE, alpha=0.55, label="before", **look)
        axes.hist(after, color=style.AFTER, alpha=0.75, label="after", **look)
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
            line = style.MUTED if colour == style.BEFORE else colour
            axes.plot(middle, median, color=line, linewidth=1.8)
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

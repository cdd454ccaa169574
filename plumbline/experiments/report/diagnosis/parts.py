"""Pictures of ranges and fiducials: residuals over the beam, on each plane, by marker."""

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from plumbline.experiments.report import style
from plumbline.experiments.report.diagnosis.figures import BRIGHTEST, drawn_pair, top_of
from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.nuisance import cosines_at_start, spots_at_start

SIGNED = "RdBu_r"  # of residuals with their sign, pale where they are none
MOST_PARTS = 12  # planes that are drawn
SPREAD = 0.16  # of dots beside the middle of their marker [markers]


def over_the_beam(subject: Subject) -> tuple[Figure, ...]:
    """Residuals of ranges over the incidence of the beam and over the range."""
    recording = subject.recording
    angle = np.rad2deg(np.arccos(np.clip(cosines_at_start(recording)[0], -1.0, 1.0)))
    with style.house_style():
        return (
            _over(subject, angle, "angle from the plane's normal [deg]"),
            _over(subject, 1e3 * recording.measured[:, 0], "range [mm]"),
        )


def _over(subject: Subject, values: Array, words: str) -> Figure:
    figure = style.new_figure(3.3, 2.6)
    axes = figure.add_subplot()
    drawn_pair(axes, values, subject.before[:, 0], subject.after[:, 0], subject.rows, signed=True)
    axes.set(xlabel=words, ylabel=f"residual [{subject.unit}]")
    return figure


def over_planes(subject: Subject) -> tuple[Figure, ...]:
    """Residuals where the beams met each plane, before and after; last their scale."""
    largest = top_of(np.abs(subject.before), BRIGHTEST)
    scale = Normalize(-largest, largest)
    count = min(len(subject.recording.elements), MOST_PARTS)
    with style.house_style():
        drawn = [_plane(subject, k, scale) for k in range(1, count + 1)]
        return (*drawn, _scale(scale, subject.unit))


def _plane(subject: Subject, plane: int, scale: Normalize) -> Figure:
    recording = subject.recording
    assert recording.element is not None
    mine = recording.element == plane
    label = recording.elements[plane - 1][:20]
    named = "" if label == str(plane) else f" ({label})"
    places = 1e3 * spots_at_start(recording)[mine]
    figure = style.new_figure(3.3, 4.9)
    axes = figure.subplots(2, 1)
    pairs = ((subject.before, "before"), (subject.after, "after"))
    for ax, (residuals, when) in zip(axes, pairs, strict=True):
        dots = ax.scatter(
            *places.T, c=residuals[mine, 0], cmap=SIGNED, norm=scale, s=16.0, linewidths=0.2,
            edgecolors="#888",
        )  # fmt: skip
        style.numbered(dots, subject.rows[mine])
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(title=f"plane {plane}{named}, {when}", ylabel="y [mm]")
        ax.xaxis.set_major_locator(MaxNLocator(4))
        ax.yaxis.set_major_locator(MaxNLocator(5))
        style.calm(ax, grid="both")
    axes[1].set_xlabel("x on the plane, from the middle [mm]")
    return figure


def _scale(scale: Normalize, unit: str) -> Figure:
    figure = style.new_figure(5.2, 0.62)
    bar = figure.add_subplot()
    drawn = figure.colorbar(ScalarMappable(scale, SIGNED), cax=bar, orientation="horizontal")
    drawn.outline.set_visible(False)
    bar.set_xlabel(f"predicted less measured range [{unit}]; larger: last colours")
    return figure


def by_marker(subject: Subject) -> tuple[Figure, ...]:
    """Distances between predicted and touched places, marker by marker, before and after."""
    recording = subject.recording
    assert recording.element is not None
    count = len(recording.elements)
    turn = np.argsort(np.argsort(recording.element, kind="stable"))  # so that dots stand apart
    beside = SPREAD * (2.0 * (turn % 5) / 4.0 - 1.0)
    with style.drawing(5.2, 2.7) as (figure, axes):
        for sizes, colour, label, shift in zip(
            subject.sizes,
            (style.BEFORE, style.AFTER),
            ("before", "after"),
            (-0.2, 0.2),
            strict=True,
        ):
            x = recording.element + shift + 0.6 * beside
            dots = axes.scatter(x, sizes, color=colour, s=14.0, alpha=0.8, lw=0, label=label)
            style.numbered(dots, subject.rows)
        axes.set(xlim=(0.5, count + 0.5), ylim=(0.0, top_of(subject.sizes[0])))
        if count <= MOST_PARTS:
            names = [f"{k}\n{name[:8]}" for k, name in enumerate(recording.elements, start=1)]
            axes.set_xticks(range(1, count + 1), names)
        axes.set(xlabel="marker", ylabel=f"distance [{subject.unit}]")
        axes.legend(loc="upper right")
        style.calm(axes)
        return (figure,)

"""Pictures of ranges and fiducials: residuals over the beam, on each plane, by marker."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from plumbline.experiments.report import style
from plumbline.experiments.report.diagnosis import figures
from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.nuisance import cosines_at_start, spots_at_start

SIGNED = mpl.colormaps["RdBu_r"]  # of residuals with their sign, pale where they are none
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
    pair = subject.before[:, 0], subject.after[:, 0]
    labels = {"xlabel": words, "ylabel": f"residual [{subject.unit}]"}
    return figures.panel(values, pair, subject.rows, signed=True, **labels)


def over_planes(subject: Subject) -> tuple[Figure, ...]:
    """Residuals where the beams met each plane, before and after; last their scale."""
    largest = figures.top_of(np.abs(subject.before), figures.BRIGHTEST)
    scale = Normalize(-largest, largest)
    count = min(len(subject.recording.elements), MOST_PARTS)
    words = f"predicted less measured range [{subject.unit}]; larger: last colours"
    with style.house_style():
        drawn = [_plane(subject, k, scale) for k in range(1, count + 1)]
        return (*drawn, figures.colour_scale(scale, SIGNED, words))


def _plane(subject: Subject, plane: int, scale: Normalize) -> Figure:
    recording = subject.recording
    assert recording.element is not None
    mine = recording.element == plane
    label = recording.elements[plane - 1][:20]
    named = "" if label == str(plane) else f" ({label})"
    x, y = 1e3 * spots_at_start(recording)[mine].T

    def drawn(axes: Axes, residuals: Array) -> None:
        dots = axes.scatter(
            x, y, c=residuals[mine, 0], cmap=SIGNED, norm=scale, s=16.0, linewidths=0.2,
            edgecolors="#888",
        )  # fmt: skip
        style.numbered(dots, subject.rows[mine])

    title, across = f"plane {plane}{named}, {{}}", "x on the plane, from the middle [mm]"
    return figures.before_above_after(
        drawn, (subject.before, subject.after), title, across, "y [mm]"
    )


def by_marker(subject: Subject) -> tuple[Figure, ...]:
    """Distances between predicted and touched places, marker by marker, before and after."""
    recording = subject.recording
    assert recording.element is not None
    count = len(recording.elements)
    turn = np.argsort(np.argsort(recording.element, kind="stable"))  # so that dots stand apart
    beside = SPREAD * (2.0 * (turn % 5) / 4.0 - 1.0)
    with style.drawing(5.2, 2.7) as (figure, axes):
        looks = (style.BEFORE, "before", -0.2), (style.AFTER, "after", 0.2)
        for sizes, (colour, label, shift) in zip(subject.sizes, looks, strict=True):
            x = recording.element + shift + 0.6 * beside
            dots = axes.scatter(x, sizes, color=colour, s=14.0, alpha=0.8, lw=0, label=label)
            style.numbered(dots, subject.rows)
        axes.set(xlim=(0.5, count + 0.5), ylim=(0.0, figures.top_of(subject.sizes[0])))
        if count <= MOST_PARTS:
            names = [f"{k}\n{name[:8]}" for k, name in enumerate(recording.elements, start=1)]
            axes.set_xticks(range(1, count + 1), names)
        axes.set(xlabel="marker", ylabel=f"distance [{subject.unit}]")
        axes.legend(loc="upper right")
        style.calm(axes)
        return (figure,)

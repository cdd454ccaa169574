"""Pictures of a hand-eye calibration: the scene, the selection loop, residuals, poses, a scan.

Lengths are drawn in mm. Every function returns one figure.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from plumbline.experiments.report import style
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye.calibrate import Calibration
from plumbline.optim.hand_eye.readings import Beam, Readings
from plumbline.optim.hand_eye.single_plane import Selection

MM = 1e3  # in a metre
BOARDS = (style.AFTER, style.FLOOR, "#cc79a7", "#e69f00")
EVERY = 4  # beams drawn, one of so many


def scene(readings: Readings, beam: Beam) -> Figure:
    """Where the flange was, and where its beams met the boards."""
    points = beam.points(readings.R, readings.t, readings.distance)
    starts = readings.R @ beam.r + readings.t
    with style.drawing(5.6, 4.6, subplot_kw={"projection": "3d"}) as (figure, axes):
        for i, k in enumerate(readings.planes):
            rows = readings.plane == k
            colour = BOARDS[i % len(BOARDS)]
            for a, b in zip(starts[rows][::EVERY], points[rows][::EVERY], strict=True):
                axes.plot(*(MM * np.stack([a, b], axis=1)), color=colour, linewidth=0.4, alpha=0.5)
            axes.scatter(*(MM * points[rows].T), s=7, color=colour, label=f"plane {k}")
        axes.scatter(*(MM * starts.T), s=4, color=style.MUTED, label="start of the beam")
        axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
        axes.set_aspect("equal")
        axes.view_init(elev=22, azim=-125)
        axes.legend(loc="upper left")
        axes.set_title("Readings, in the base frame")
    return figure


def selection_curves(selections: Sequence[Selection], mean: Array | None = None) -> Figure:
    """Repeatability over the iterations of the loop, plane by plane; the kept ones marked."""
    with style.drawing(5.2, 3.0) as (figure, axes):
        for i, selection in enumerate(selections):
            colour = BOARDS[i % len(BOARDS)]
            axes.plot(MM * selection.curve, color=colour, linewidth=1.3, label=f"plane {i + 1}")
            least = MM * selection.curve[selection.kept]
            axes.plot(selection.kept, least, "o", color=colour, markersize=6)
        if mean is not None:
            axes.plot(MM * mean, color=style.MUTED, linewidth=2.2, label="mean of all set-ups")
        axes.set(xlabel="readings dropped", ylabel="repeatability [mm]")
        axes.set_title("The selection loop falls while poor readings leave, then rises")
        axes.legend()
        style.calm(axes)
    return figure


def residuals(calibration: Calibration) -> Figure:
    """What the fit leaves over, over the incidence, with the scatter that it found."""
    c = calibration
    with style.drawing(5.2, 3.0) as (figure, axes):
        angle = np.rad2deg(c.incidence)
        dots = axes.scatter(angle, MM * c.errors, s=9, color=style.AFTER, alpha=0.7, linewidths=0)
        style.numbered(dots, c.readings.row)
        grid = np.linspace(0.0, float(c.incidence.max()), 50)
        sigma = MM * np.sqrt(c.variance.at(grid))
        for sign in (-2.0, 2.0):
            axes.plot(np.rad2deg(grid), sign * sigma, color=style.MUTED, linewidth=1.2)
        axes.set(xlabel="angle between beam and normal [deg]", ylabel="distance from board [mm]")
        axes.set_title("What is left over; lines at two sigmas, as fitted")
        style.calm(axes)
    return figure


def bows(calibration: Calibration) -> Figure:
    """How far each board stands out of its plane where it was read."""
    c = calibration
    heights, count = MM * c.heights(), len(c.frames.c)
    points = c.beam.points(c.readings.R, c.readings.t, c.readings.distance)
    index, top = c.frames.index(c.readings), float(np.abs(heights).max() or 1.0)
    with style.house_style():
        figure = style.new_figure(2.5 * count + 0.6, 2.6)
        panels = np.atleast_1d(figure.subplots(1, count, sharey=True))
        for k, axes in enumerate(panels):
            rows = index == k
            places = MM * (points[rows] - c.frames.c[k]) @ c.frames.B[k][:, :2]
            drawn = _dots(axes, places, heights[rows], top)
            style.numbered(drawn, c.readings.row[rows])
            axes.set(title=f"plane {c.readings.planes[k]}", xlabel="on the board [mm]")
        panels[0].set_ylabel("[mm]")
        figure.colorbar(drawn, ax=panels.tolist(), label="out of its plane [mm]")
    return figure


def _dots(axes: Axes, places: Array, heights: Array, top: float) -> PathCollection:
    axes.set_aspect("equal", adjustable="datalim")
    style.calm(axes, grid="both")
    x, y = places.T
    return axes.scatter(x, y, c=heights, cmap=style.SIZES, vmin=-top, vmax=top, s=42, linewidths=0)


def scan(points: Array, distances: Array, targets: Array, found: Array) -> Figure:
    """A scanned head (N, 3) [m] by its distance (N,) from CT; targets (k, 3), true and found."""
    with style.drawing(5.4, 4.4, subplot_kw={"projection": "3d"}) as (figure, axes):
        drawn = axes.scatter(
            *(MM * points.T), c=MM * distances, cmap=style.SIZES, s=5, linewidths=0, vmax=1.0
        )
        axes.scatter(
            *(MM * targets.T), s=36, facecolors="none", edgecolors=style.MUTED, label="target"
        )
        axes.scatter(*(MM * found.T), s=10, color=style.GUILTY, label="by the scan")
        axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
        axes.set_aspect("equal")
        axes.view_init(elev=18, azim=-115)
        axes.legend(loc="upper left")
        figure.colorbar(drawn, ax=axes, shrink=0.6, label="from the CT surface [mm]")
    return figure

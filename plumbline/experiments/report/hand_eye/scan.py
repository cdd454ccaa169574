"""What is said of a scan: angles between faces, where it lies on a surface, its points."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report.hand_eye.pictures import BOARDS, MM
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture
from plumbline.experiments.report.style import SIZES, house_style, new_figure
from plumbline.optim.core.quantities import counted, quantity
from plumbline.optim.hand_eye.scan import ScanAnswer


def page(answer: ScanAnswer) -> Page:
    """The page of an answer."""
    angles, laid = _angles(answer), _surface(answer)
    rest = ", ".join(
        f"{label} {quantity(float(rms), 'm')}"
        for label, rms in zip(answer.recording.labels, answer.flatness, strict=True)
    )
    gross, notes = sum(answer.left_out), list(answer.recording.notes)
    notes += [f"{counted(gross, 'gross reading')} left out"] * bool(gross)
    notes += [f"left over of the faces, RMS: {rest}"] * bool(rest)
    return Page(
        name=answer.recording.name,
        verdict=f"{counted(len(answer.points), 'reading')} rebuilt",
        tone="explained",
        lead=(),
        tiles=(),
        parts=(*angles, *laid, *([Part("Notes", (), None, notes)] if notes else []),
               partial(_picture, answer)),
        sha256=answer.recording.sha256,
    )  # fmt: skip


def _angles(answer: ScanAnswer) -> list[Part]:
    rows = [
        [" and ".join(a.faces), f"{np.rad2deg(a.angle):.2f} ± {np.rad2deg(a.std):.2f} deg"]
        for a in answer.angles
    ]
    grid = Grid(("faces", "angle ± standard error"), rows, (1,))
    return [Part("Angles between faces", (), grid)] if rows else []


def _surface(answer: ScanAnswer) -> list[Part]:
    laid = answer.laid
    if laid is None:
        return []
    d = laid.distances
    mean, spread, most = (quantity(float(x), "m") for x in (d.mean(), d.std(), d.max()))
    words = (
        f"Points lie {mean} from it, spread {spread}, largest {most}; standard error at the "
        f"scan's edge {quantity(laid.edge, 'm')}.",
    )
    named = zip(answer.recording.target_labels, laid.targets, laid.stds, strict=True)
    rows = [
        [label, *(f"{x:.2f}" for x in MM * point), quantity(float(std), "m")]
        for label, point, std in named
    ]
    columns = ("target", "x [mm]", "y [mm]", "z [mm]", "standard error")
    grid = Grid(columns, rows, range(1, 5)) if rows else None
    return [Part("Laid on the surface of CT", words, grid)]


def _picture(answer: ScanAnswer) -> Picture:
    title = "Rebuilt points"
    return Picture("scan", title, "In the base frame.", (scan_picture(answer),), wide=True)


def scan_picture(answer: ScanAnswer) -> Figure:
    """The rebuilt points: by face, or by their distance from the surface [mm]."""
    points, face = MM * answer.points, answer.recording.face
    with house_style():
        figure = new_figure(5.4, 4.4)
        axes: Any = figure.add_subplot(projection="3d")
        if answer.laid is not None:
            colours = MM * answer.laid.distances
            drawn = axes.scatter(*points.T, c=colours, cmap=SIZES, s=6, linewidths=0)
            figure.colorbar(drawn, ax=axes, shrink=0.6, label="from the surface [mm]")
        elif face is not None:
            for i, k in enumerate(np.unique(face)):
                colour = BOARDS[i % len(BOARDS)]
                label = answer.recording.labels[i]
                axes.scatter(*points[face == k].T, s=9, color=colour, label=label)
            axes.legend(loc="upper left")
        axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
        axes.set_aspect("equal")
        axes.set_title("Rebuilt points, in the base frame")
    return figure

"""A scan in plain words, and as one HTML file with its pictures inside."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report.hand_eye.pictures import BOARDS, MM
from plumbline.experiments.report.page.page import Page, Part, Picture
from plumbline.experiments.report.style import SIZES, house_style, new_figure
from plumbline.optim.core.quantities import counted, quantity
from plumbline.optim.hand_eye.scan import ScanAnswer


def scan_words(answer: ScanAnswer) -> str:
    """The answer, line by line."""
    lines = [f"{answer.recording.name}: {counted(len(answer.points), 'reading')}"]
    if answer.angles:
        lines += ["", "Angles between faces, ± standard error", *_angle_lines(answer)]
    if answer.laid is not None:
        lines += ["", "Laid on the surface of CT", *_surface_lines(answer)]
    lines += [f"note: {note}" for note in answer.recording.notes]
    return "\n".join(lines)


def _angle_lines(answer: ScanAnswer) -> list[str]:
    found = [
        f"  {' and '.join(a.faces)}: {np.rad2deg(a.angle):.2f} ± {np.rad2deg(a.std):.2f} deg"
        for a in answer.angles
    ]
    flat = zip(answer.recording.labels, answer.flatness, strict=True)
    rest = ", ".join(f"{label} {quantity(float(rms), 'm')}" for label, rms in flat)
    gross = sum(answer.left_out)
    out = [f"  {counted(gross, 'gross reading')} left out"] if gross else []
    return [*found, f"  left over, rms: {rest}", *out]


def _surface_lines(answer: ScanAnswer) -> list[str]:
    laid = answer.laid
    assert laid is not None
    d = laid.distances
    mean, spread, most = (quantity(float(x), "m") for x in (d.mean(), d.std(), d.max()))
    lines = [
        f"  points lie {mean} from it, spread {spread}, largest {most}",
        f"  standard error at the scan's edge: {quantity(laid.edge, 'm')}",
    ]
    named = zip(answer.recording.target_labels, laid.targets, laid.stds, strict=True)
    for label, point, std in named:
        place = ", ".join(f"{x:.2f}" for x in MM * point)
        lines.append(f"  target {label} at ({place}) mm, ± {quantity(float(std), 'm')}")
    return lines


def page(answer: ScanAnswer) -> Page:
    """The page of an answer."""
    lines = scan_words(answer).split("\n")
    title = "Rebuilt points"
    picture = Picture("scan", title, "In the base frame.", (scan_picture(answer),), wide=True)
    said = [line.strip() for line in lines[1:] if line.strip()]
    return Page(
        name=answer.recording.name,
        verdict="Scan rebuilt",
        tone="explained",
        lead=lines[:1],
        tiles=(),
        parts=(Part("What was found", (), None, said), picture),
        sha256=answer.recording.sha256,
    )


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

"""What is said of a scan: angles between faces, where it lies on a surface, its points."""

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report.hand_eye.pictures import BOARDS, MM
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture, Tile
from plumbline.experiments.report.style import SIZES, by_depth, drawing, numbered
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import counted, quantity
from plumbline.optim.hand_eye.scan import ScanAnswer
from plumbline.optim.recording.constants import FIRST_ROW


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
        lead=_lead(answer),
        tiles=_tiles(answer),
        parts=(*angles, *laid, *([Part("Notes", (), None, notes)] if notes else []),
               lambda: Picture.of("hand_eye.scan", scan_picture(answer))),
        sha256=answer.recording.sha256,
    )  # fmt: skip


def _lead(answer: ScanAnswer) -> list[str]:
    said = []
    if answer.laid is not None:
        said.append(
            f"CT lies on the scan: points are {_mean(answer.laid.distances)} from its surface, and "
            f"it is placed to {quantity(answer.laid.edge, 'm')} at the scan's edge."
        )
    if answer.angles:
        worst = np.rad2deg(max(a.std for a in answer.angles))
        said.append(f"Faces meet at the angles below, known to {worst:.2f} deg or better.")
    return said


def _tiles(answer: ScanAnswer) -> list[Tile]:
    if answer.laid is None:
        return []
    tiles = [
        Tile("from the surface", _mean(answer.laid.distances), "mean"),
        Tile("at the scan's edge", quantity(answer.laid.edge, "m"), "standard error"),
    ]
    if len(answer.laid.stds):
        tiles.append(
            Tile("targets", quantity(float(answer.laid.stds.max()), "m"), "standard error, at most")
        )
    return tiles


def _mean(distances: Array) -> str:
    return quantity(float(distances.mean()), "m")


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
    spread, most = (quantity(float(x), "m") for x in (laid.distances.std(), laid.distances.max()))
    words = (f"Distances spread by {spread}; the largest is {most}.",)
    named = zip(answer.recording.target_labels, laid.targets, laid.stds, strict=True)
    rows = [
        [label, *(f"{x:.2f}" for x in MM * point), quantity(float(std), "m")]
        for label, point, std in named
    ]
    columns = ("target", "x [mm]", "y [mm]", "z [mm]", "standard error")
    grid = Grid(columns, rows, range(1, 5)) if rows else None
    return [Part("Laid on the surface of CT", words, grid)]


def scan_picture(answer: ScanAnswer) -> Figure:
    """The rebuilt points: by face, or by their distance from the surface [mm]."""
    points, face = MM * answer.points, answer.recording.face
    clouds = []
    with drawing(5.4, 4.4, subplot_kw={"projection": "3d"}) as (figure, axes):
        if answer.laid is not None:
            colours = MM * answer.laid.distances
            drawn = axes.scatter(*points.T, c=colours, cmap=SIZES, s=6, linewidths=0)
            clouds.append((drawn, np.arange(len(points))))
            figure.colorbar(drawn, ax=axes, shrink=0.6, label="from the surface [mm]")
        elif face is not None:
            for i, k in enumerate(np.unique(face)):
                colour = BOARDS[i % len(BOARDS)]
                label = answer.recording.labels[i]
                drawn = axes.scatter(*points[face == k].T, s=9, color=colour, label=label)
                clouds.append((drawn, np.flatnonzero(face == k)))
            axes.legend(loc="upper left")
        axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
        axes.locator_params(nbins=5)
        axes.set_aspect("equal")
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.labelpad = 10.0  # points, past the numbers
        axes.set_box_aspect(None, zoom=0.85)
        for cloud, rows in clouds:
            numbered(cloud, rows[by_depth(axes, points[rows])] + FIRST_ROW)
    return figure

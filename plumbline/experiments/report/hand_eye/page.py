"""A hand-eye calibration on a page: beam and errors, planes, worst readings, next poses."""

from functools import partial

import numpy as np

from plumbline.errors import listed
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture, Tile
from plumbline.optim.core.quantities import counted, measured, quantity
from plumbline.optim.hand_eye.answer import HandEye

MM = 1e3  # in a metre
SHOWN = 12  # worst readings
MOST_ROWS = 24  # gross rows that are listed by number


def page(answer: HandEye) -> Page:
    """The page of an answer."""
    c, good = answer.calibration, answer.judged.converged
    r = ", ".join(f"{MM * v:.2f}" for v in c.beam.r)
    planes = counted(len(answer.boards), "plane")
    return Page(
        name=answer.name,
        verdict="Calibrated" if good else "Not converged",
        tone="explained" if good else "outside-library",
        lead=(
            f"The beam starts at ({r}) mm on the flange, by {answer.rows} readings on {planes}. A "
            f"point rebuilt with it errs by {quantity(answer.point_std, 'm')} by its own error.",
        ),
        tiles=_tiles(answer, planes),
        parts=(_beam(answer), partial(_pictures, answer), _planes(answer), _worst(answer),
               *_rest(answer)),
        warnings=tuple(f"not to be relied on: {line}" for line in answer.judged.failures),
    )  # fmt: skip


def _tiles(answer: HandEye, planes: str) -> list[Tile]:
    straight, slanted = np.sqrt(answer.calibration.variance.at(np.array([0.0, np.pi / 6])))
    tiles = [
        Tile("rebuilt points", quantity(answer.point_std, "m"), "standard error, by the beam"),
        Tile("readings", f"{answer.rows} readings", f"on {planes}"),
        Tile(
            "scatter of a reading", quantity(straight, "m"), f"{quantity(slanted, 'm')} at 30 deg"
        ),
    ]
    if answer.repeatability is not None:
        tiles.append(Tile("repeatability on marks", quantity(answer.repeatability, "m")))
    if answer.held_out is not None:
        tiles.append(Tile("held-out readings", quantity(answer.held_out, "m"), "from the planes"))
    return tiles


def _beam(answer: HandEye) -> Part:
    c = answer.calibration
    of = (("r", c.beam.r, c.std[:3], "m", "origin of the beam on the flange"),
          ("v", c.beam.v, c.std[3:], "", "direction of the beam"))  # fmt: skip
    rows = [
        [f"{name}_{axis}", measured(values[k], std[k], unit), doc]
        for name, values, std, unit, doc in of
        for k, axis in enumerate("xyz")
    ]
    grid = Grid(("", "value ± standard error", "meaning"), rows, (1,), sorts=False)
    return Part("Where the beam sits on the flange", (), grid)


def _pictures(answer: HandEye) -> Picture:
    from plumbline.experiments.report.hand_eye.pictures import bows, residuals

    return Picture.of("hand_eye.left", residuals(answer.calibration), bows(answer.calibration))


def _planes(answer: HandEye) -> Part:
    rows = [
        [b.label, str(b.rows), f"{MM * b.rms:.3f}", f"{MM * b.unflatness:.3f}"]
        for b in answer.boards
    ]
    angles = ", ".join(f"{a:.2f}" for a in np.rad2deg(answer.angles))
    words = (f"Angles between them: {angles} deg.",) if len(answer.angles) else ()
    columns = ("plane", "readings", "left over, RMS [mm]", "not flat, RMS [mm]")
    return Part("Planes", words, Grid(columns, rows, range(1, 4)))


def _worst(answer: HandEye) -> Part:
    c = answer.calibration
    index = c.frames.index(c.readings)
    rows = []
    for k in np.argsort(-np.abs(c.errors), kind="stable")[:SHOWN]:
        plane = answer.boards[index[k]].label if index[k] < len(answer.boards) else str(index[k])
        place = [f"{MM * c.readings.distance[k]:.2f}", f"{np.rad2deg(c.incidence[k]):.1f}"]
        rows.append([str(c.readings.row[k]), f"{MM * c.errors[k]:+.3f}", plane, *place])
    columns = ("line", "from its plane [mm]", "plane", "range [mm]", "incidence [deg]")
    grid = Grid(columns, rows, range(5))
    return Part("The readings that are missed most", (), grid, on_paper=True)


def _gross(answer: HandEye) -> str:
    rows = answer.calibration.gross
    if not len(rows):
        return "none"
    named = listed(rows, MOST_ROWS)
    return f"{counted(len(rows), 'reading')} left out: lines {named} of samples.csv"


def _rest(answer: HandEye) -> list[Part]:
    parts = [Part("Gross readings", (), None, (_gross(answer),))]
    if answer.calibration.seen.unseen:
        title = "What these readings cannot tell"
        parts.append(Part(title, (), None, answer.calibration.seen.unseen))
    if answer.next:
        rows = []
        for k, pose in enumerate(answer.next, start=1):
            place = ", ".join(f"{MM * x:.0f}" for x in pose.position)
            joints = "" if pose.q is None else ", ".join(f"{x:.3f}" for x in pose.q)
            spot = [f"{MM * pose.distance:.0f}", f"{np.rad2deg(pose.incidence):.0f}"]
            rows.append(
                [str(k), str(pose.plane), place, *spot, quantity(pose.point_std, "m"), joints]
            )
        columns = ("", "plane", "flange [mm]", "range [mm]", "deg", "then", "q [rad]")
        parts.append(Part("What to measure next", (), Grid(columns, rows, (0, 3, 4))))
    return [*parts, *([Part("Notes", (), None, answer.notes)] if answer.notes else [])]

"""A hand-eye calibration in plain words on a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from plumbline.optim.core.quantities import counted, measured, quantity
from plumbline.optim.hand_eye.answer import HandEye

MOST_ROWS = 24  # gross rows that are listed by number


def print_answer(answer: HandEye, console: Console) -> None:
    """Print an answer."""
    console.print(Group(*_sections(answer)), highlight=False)


def _sections(answer: HandEye) -> Iterator[RenderableType]:
    planes = counted(len(answer.boards), "plane")
    heading = f": {counted(answer.rows, 'reading')} on {planes}"
    yield Text.assemble((answer.name, "bold"), (heading, "dim"))
    yield from _section("Where the beam sits on the flange, ± standard error", _beam(answer))
    yield from _section("How well points are rebuilt", *_points(answer))
    yield from _section("Planes", _planes(answer))
    yield from _section("Gross readings", Text(gross_words(answer)))
    yield from _section(
        "What these readings cannot tell", *_bullets(answer.calibration.seen.unseen)
    )
    if answer.next:
        yield from _section("What to measure next", _next(answer))
    if answer.notes:
        yield from _section("Notes", *_bullets(answer.notes))


def _beam(answer: HandEye) -> Table:
    c, table = answer.calibration, Table.grid(padding=(0, 2))
    for k, axis in enumerate("xyz"):
        v, std = c.beam.v[k], c.std[3 + k]
        table.add_row(
            Text(f"r_{axis}"),
            Text(measured(c.beam.r[k], c.std[k], "m")),
            Text(f"v_{axis}"),
            Text(f"{v:.5f} ± {std:.5f}"),
        )
    return table


def _points(answer: HandEye) -> Iterator[Text]:
    c = answer.calibration
    if answer.repeatability is not None:
        yield Text(f"repeatability on marks: {quantity(answer.repeatability, 'm')}")
    error = quantity(answer.point_std, "m")
    yield Text(f"standard error of a rebuilt point, by the beam's own error: {error}")
    sizes = [np.sqrt(max(c.variance.at(np.array([a]))[0], 0.0)) for a in (0.0, np.pi / 6)]
    straight, slanted = (quantity(float(s), "m") for s in sizes)
    yield Text(f"a reading scatters by {straight} straight on, by {slanted} at 30 deg")
    if answer.held_out is not None:
        yield Text(f"held-out readings lie {quantity(answer.held_out, 'm')} from the planes (rms)")


def _planes(answer: HandEye) -> Table:
    table = Table.grid(padding=(0, 2))
    for heading in ("plane", "readings", "left over, rms", "not flat, rms"):
        table.add_column(heading)
    table.add_row(*(Text(str(c.header), "dim") for c in table.columns))
    for board in answer.boards:
        left, bow = quantity(board.rms, "m"), quantity(board.unflatness, "m")
        table.add_row(Text(board.label), Text(str(board.rows)), Text(left), Text(bow))
    if len(answer.angles):
        angles = ", ".join(f"{a:.2f}" for a in np.rad2deg(answer.angles))
        table.add_row(Text("angles"), Text(f"{angles} deg"))
    return table


def gross_words(answer: HandEye) -> str:
    """The rows taken for gross errors, by their numbers in the file."""
    rows = answer.calibration.gross
    if not len(rows):
        return "none"
    listed = ", ".join(str(row) for row in rows[:MOST_ROWS])
    more = f" and {len(rows) - MOST_ROWS} more" if len(rows) > MOST_ROWS else ""
    return f"{counted(len(rows), 'reading')} left out: rows {listed}{more} of samples.csv"


def _next(answer: HandEye) -> Table:
    table = Table.grid(padding=(0, 2))
    for k, pose in enumerate(answer.next, start=1):
        place = ", ".join(f"{x * 1e3:.0f}" for x in pose.position)
        joints = ""
        if pose.q is not None:
            joints = "q = " + ", ".join(f"{x:.3f}" for x in pose.q)
        table.add_row(
            Text(str(k)),
            Text(f"plane {pose.plane}"),
            Text(f"flange at ({place}) mm"),
            Text(f"range {pose.distance * 1e3:.0f} mm, {np.rad2deg(pose.incidence):.0f} deg"),
            Text(f"then {quantity(pose.point_std, 'm')}"),
            Text(joints, "dim"),
        )
    return table


def _section(title: str, *parts: RenderableType) -> Iterator[RenderableType]:
    yield Text(f"\n{title}", style="bold")
    yield from (Padding(part, (0, 0, 0, 2), expand=False) for part in parts)


def _bullets(lines: Iterable[str]) -> Iterator[Table]:
    for line in lines:
        table = Table.grid(padding=(0, 1))
        table.add_row("•", Text(line))
        yield table

"""``plumbline next FOLDER``: the rows to record next, and what they are expected to settle."""

from __future__ import annotations

import csv as csv_module
import io
import math
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.commands import (
    CommandError,
    Json,
    Quiet,
    check_distinct,
    check_output,
    talks,
    write_json,
    write_text,
)
from experiments.commands.progress import progress_bar

if TYPE_CHECKING:
    from rich.table import Table

    from optim.diagnosis.next_experiment import NextExperiment, Suggestion
    from optim.recording import Recording

MOST = 100
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
SIDES = {-1: "-", 0: "0", 1: "+"}


class Range(StrEnum):
    """How far the joints may go."""

    RECORDED = "recorded"
    LIMITS = "limits"


Folder = Annotated[Path, typer.Argument(help="A recording: dataset.toml and samples.csv.")]
Count = Annotated[int, typer.Option(min=1, max=MOST, help="How many rows.")]
Seed = Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Seed of every random draw.")]
Csv = Annotated[
    Path | None, typer.Option(metavar="OUT.csv", help="Write a samples.csv to be filled in.")
]
Within = Annotated[
    Range, typer.Option(help="Joints within the range recorded so far, or within their limits.")
]


def next_(
    folder: Folder,
    count: Count = 12,
    json: Json = None,
    csv: Csv = None,
    seed: Seed = 0,
    within: Within = Range.RECORDED,
    quiet: Quiet = False,
) -> None:
    """Say which rows to record next, so as to tell the leading explanations apart."""
    check_output(json, "--json", [folder])
    check_output(csv, "--csv", [folder])
    if str(csv) == "-":
        raise CommandError("--csv -: name a file")
    check_distinct({"--json": json, "--csv": csv})
    from optim.diagnosis import diagnose as diagnosis_module
    from optim.diagnosis.design import Options
    from optim.diagnosis.next_experiment import next_experiment
    from optim.loading import load_recording

    recording = load_recording(folder)
    with progress_bar(quiet=quiet or json == "-") as progress:
        diagnosis = diagnosis_module.diagnose(recording, seed=seed, progress=progress)
    options = Options(count=count, seed=seed, within=within.value)
    found = next_experiment(diagnosis.found, diagnosis.verdict, options)
    write_json(json, {"recording": recording.name, **found.to_dict()})
    if csv is not None:
        write_text(csv, table_to_fill(recording, found), "--csv")
    if talks(json, quiet):
        _print(recording, found)


def table_to_fill(recording: Recording, found: NextExperiment) -> str:
    """The rows as a samples.csv; what only the next session can tell is left empty."""
    from optim.kinds import KINDS

    joints = range(1, recording.chain.n + 1)
    measured = list(KINDS[recording.observation].columns)
    if recording.observation == "joint_position":
        measured = [f"m{j + 1}" for j in recording.measured_joints]
    later = [c for c in ("time", "temperature") if getattr(recording, c) is not None]
    out = io.StringIO()
    writer = csv_module.writer(out, lineterminator="\n")
    rows = [_cells(row) for row in found.rows]
    known = list(rows[0]) if rows else [f"q{j}" for j in joints]
    writer.writerow([*known, *measured, *later])
    for cells in rows:
        writer.writerow([*cells.values(), *[""] * (len(measured) + len(later))])
    return out.getvalue()


def _cells(row: Suggestion) -> dict[str, str]:
    """Cells of a row by the names of their columns."""
    named = {"q": row.pose, "direction": row.direction, "velocity": row.velocity}
    cells = {
        f"{name}{j}": f"{value:.9g}"
        for name, values in named.items()
        for j, value in enumerate(values or (), start=1)
    }
    if row.payload is not None:
        cells["payload"] = f"{row.payload:.6g}"
    whole = {"socket": row.socket, "group": row.group}
    return cells | {name: str(value) for name, value in whole.items() if value is not None}


def _print(recording: Recording, found: NextExperiment) -> None:
    from rich.console import Console

    from optim.diagnosis.words import counted, percent

    console = Console(highlight=False)
    console.print(f"[bold]{recording.name}[/bold]: {counted(len(recording), 'row')} leave open")
    triples = zip(LETTERS, found.explanations, found.probabilities, strict=False)
    for letter, label, probability in triples:
        console.print(f"  {letter}  {percent(probability):>6}  {label}", markup=False)
    if found.rows:
        console.print("", _table(found))
        console.print(_legend(found), markup=False)
    if found.forecast is not None:
        console.print(f"\n{found.forecast.words}", markup=False)
    for note in found.notes:
        console.print(f"• {note[0].upper()}{note[1:]}", markup=False)


def _table(found: NextExperiment) -> Table:
    from rich import box
    from rich.table import Table

    title = "Rows to record next, in this order"
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    shown = [_context(row, found) for row in found.rows]
    used = [name for name in shown[0] if any(cells[name] for cells in shown)]
    for heading in ("row", *used):
        table.add_column(heading, justify="right" if heading == "row" else "left", no_wrap=True)
    for k, cells in enumerate(shown, start=1):
        table.add_row(str(k), *(cells[name] for name in used))
    return table


def _context(row: Suggestion, found: NextExperiment) -> dict[str, str]:
    """Cells of a row by the heading of their column; empty where there is nothing to say."""
    side, speed = row.direction, row.velocity
    posture = _padded(f"{v:.3f}" for v in row.pose)
    if "revolute" in found.kinds:
        posture += "\n" + _padded(
            f"{math.degrees(v):.0f}°" if kind == "revolute" else ""
            for v, kind in zip(row.pose, found.kinds, strict=True)
        )
    if speed is not None and any(speed):
        posture += "\n" + _padded(f"{v:.2f}/s" for v in speed)
    letters = [LETTERS[found.explanations.index(name)] for name in row.separates]
    return {
        _heading(found): posture,
        "side": "" if side is None else "".join(SIDES[s] for s in side),
        "wait": f"{row.wait:.0f} s" if row.wait else "",
        "payload": "" if row.payload is None else f"{row.payload:.3g} kg",
        "socket": "" if row.socket is None else str(row.socket),
        "tells": " from ".join(letters),
    }


def _heading(found: NextExperiment) -> str:
    unit = "rad" if "prismatic" not in found.kinds else "rad, m"
    return f"joints 1 to {len(found.kinds)} [{unit}; deg]".replace("[", "\\[")


def _padded(cells: Iterable[str]) -> str:
    return " ".join(f"{cell:>7}" for cell in cells)


def _legend(found: NextExperiment) -> str:
    said = ["tells: the two explanations above that the row does most to tell apart"]
    if found.rows[0].direction is not None:
        said.insert(0, "side: + reach the posture from below, - from above, joint by joint")
    if any(row.wait for row in found.rows):
        said.insert(-1, "wait: let the arm rest so long before the row")
    return "; ".join(said) + "."

"""``plumbline next FOLDER``: the rows to record next, and what they are expected to settle."""

from __future__ import annotations

import csv as csv_module
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from plumbline.errors import PlumblineError, best_matches, fault, shown
from plumbline.experiments.commands.diagnose import Folder, Force, Seed
from plumbline.experiments.commands.out import Out, with_out
from plumbline.experiments.commands.verdicts import next_efforts, next_motion
from plumbline.experiments.console import outputs
from plumbline.experiments.console.progress_bar import progress_bar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.table import Table

    from plumbline.optim.diagnosis.design.next_experiment import (
        Forecast,
        NextExperiment,
        Suggestion,
    )
    from plumbline.optim.diagnosis.options import DiagnosisOptions
    from plumbline.optim.recording.recording import Recording

MOST = 100  # rows that may be asked for at once
WIDEST = 1000  # characters of a line: more than 100 joints take
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
NAMED = 3  # causes of an explanation that a line names
SIDES = {-1: "-", 0: "0", 1: "+"}


Count = Annotated[int, typer.Option(min=1, max=MOST, help="How many rows.")]
Csv = Annotated[
    Path | None, typer.Option(metavar="OUT.csv", help="Write a samples.csv to be filled in.")
]
Within = Annotated[
    Literal["recorded", "limits"],
    typer.Option(help="Joints within the range recorded so far, or within their limits."),
]
Of = Annotated[
    str, typer.Option("--of", metavar="NAME", help="Of a session: the recording to go on with.")
]


def refuse_parts(folder: Path) -> None:
    """Refuse ranges and fiducials, for which no rows are proposed here."""
    from plumbline.optim.recording.loading import open_folder

    opened = open_folder(folder)
    instead = {
        "plane_range": "run plumbline handeye FOLDER, which proposes poses",
        "fiducials": "touch each marker again, and add some where plumbline diagnose cannot tell",
    }
    kind = opened.settings.word("observation") or ""
    if kind in instead:
        raise PlumblineError(
            f"{opened.name}: {kind}, tips, poses, sockets or joints expected to propose rows for; "
            f"{instead[kind]}"
        )


@with_out
def next_(
    out: Out,
    folder: Folder,
    count: Count = 12,
    csv: Csv = None,
    seed: Seed = 0,
    within: Within = "recorded",
    of: Of = "",
    force: Force = False,
) -> None:
    """Say which rows to record next, so as to tell the leading explanations apart."""
    out.check([folder], csv=csv)
    from plumbline.optim.diagnosis import diagnose as diagnosis_module
    from plumbline.optim.diagnosis.design.next_experiment import next_experiment
    from plumbline.optim.diagnosis.design.rows import DesignOptions
    from plumbline.optim.diagnosis.options import DiagnosisOptions
    from plumbline.optim.recording.loading import load_recording, open_folder
    from plumbline.optim.recording.session import is_session

    if is_session(folder):
        asked = DiagnosisOptions(seed=seed, force=force)
        part, found, place = _of_session(folder, of, asked, count, within, out.silent)
        _hand_out(out, part, found, place, csv)
        return
    if of:
        raise PlumblineError(f"--of {of}: {folder} is one recording; leave it out")
    if open_folder(folder).settings.word("observation") in ("motion", "tracking"):
        next_motion(out, folder, csv, seed=seed)
        return
    refuse_parts(folder)
    recording = load_recording(folder)
    if recording.kind.efforts:
        next_efforts(out, recording, csv, DiagnosisOptions(seed=seed, force=force))
        return
    with progress_bar(quiet=out.silent) as progress:
        asked = DiagnosisOptions(seed=seed, force=force)
        diagnosis = diagnosis_module.diagnose(recording, asked, progress=progress)
    options = DesignOptions(count=count, seed=seed, within=within)
    found = in_new_groups(
        recording, next_experiment(diagnosis.selected, diagnosis.verdict, options)
    )
    _hand_out(out, recording, found, folder, csv)


def _of_session(
    folder: Path, name: str, options: DiagnosisOptions, count: int, within: str, silent: bool
) -> tuple[Recording, NextExperiment, Path]:
    """Rows for one recording of a session by what all of them leave open; its folder."""
    from plumbline.optim.diagnosis.answer import Diagnosis
    from plumbline.optim.diagnosis.design.next_experiment import next_experiment
    from plumbline.optim.diagnosis.design.rows import DesignOptions
    from plumbline.optim.diagnosis.of_any_kind import diagnose_several
    from plumbline.optim.diagnosis.several.sections import Sections
    from plumbline.optim.loading import parts_of_session
    from plumbline.optim.model.making import number_of
    from plumbline.optim.recording.kinds import PLACES
    from plumbline.optim.recording.session import open_session

    stated = open_session(folder)
    places = [stated.place / one for one in stated.recordings]
    parts = parts_of_session(stated)
    if name and name not in [part.name for part in parts]:
        near = best_matches(name, [part.name for part in parts])
        raise fault("--of", shown(name), "one of the session", f"best matches: {near}")
    with progress_bar(quiet=silent) as progress:
        found = diagnose_several(folder, options, progress=progress)
    if isinstance(found, Sections):
        found = found.of(name) if name else found.sections[0]
    session = found.recording.session if isinstance(found, Diagnosis) else None
    part = None if session is None else session.parts[number_of(session, name)]
    kind = found.recording.observation if part is None else part.observation
    if (
        not isinstance(found, Diagnosis)
        or part is None
        or kind not in PLACES
        or part.socket is not None
    ):
        raise PlumblineError(
            f"{folder}: {kind}, tips, poses or second encoders expected to propose rows for; name "
            "such a recording with --of, or ask for the next rows of one recording's folder"
        )
    asked = DesignOptions(count=count, seed=options.seed, within=within, recording=part.name)
    own = next(p for p, one in zip(places, parts, strict=True) if one.sha256 == part.sha256)
    return part, next_experiment(found.selected, found.verdict, asked), own


def _hand_out(
    out: Out, recording: Recording, found: NextExperiment, folder: Path, csv: Path | None
) -> None:
    outputs.write_json(out.json, {"recording": recording.name, **found.to_dict()})
    if csv is not None and found.rows:
        outputs.write_text(csv, table_to_fill(folder, recording, found), "--csv")
    if not out.silent:
        _print(recording, found)
    if csv is not None and not found.rows and not out.quiet:
        typer.echo(f"--csv {csv}: not written, there are no rows to propose", err=True)


def in_new_groups(recording: Recording, found: NextExperiment) -> NextExperiment:
    """The rows in groups of their own, numbered after the last one, as many as they came in.

    A recording of a single group keeps it: beside a second one, all old rows would be left out of
    a fit together.
    """
    import numpy as np

    if recording.group is None or len(np.unique(recording.group)) < 2:
        return found
    labels = sorted({row.group for row in found.rows if row.group is not None})
    first = int(recording.group.max()) + 1
    number = {label: first + k for k, label in enumerate(labels)}
    rows = (
        row if row.group is None else replace(row, group=number[row.group]) for row in found.rows
    )
    return replace(found, rows=tuple(rows))


def table_to_fill(folder: Path, recording: Recording, found: NextExperiment) -> str:
    """The rows in the columns of the folder's own samples.csv; what is to be measured is empty."""
    from plumbline.optim.recording.columns import as_in_file
    from plumbline.optim.recording.loading import SAMPLES, open_folder, read_bytes
    from plumbline.optim.recording.table import decode

    opened = open_folder(folder)
    joints = as_in_file(
        opened.table, recording.robot, recording.chain, opened.settings, _jointwise(found.rows)
    )
    data = read_bytes(folder, SAMPLES)
    lines = csv_module.reader(io.StringIO(decode(SAMPLES, data), newline=""))
    header = next(line for line in lines if "".join(line).strip())
    out = io.StringIO()
    writer = csv_module.writer(out, lineterminator="\n")
    writer.writerow(header)
    for k, (row, time) in enumerate(zip(found.rows, _times(recording, found), strict=True)):
        cells = {name: f"{values[k]:.9g}" for name, values in joints.items()} | _cells(row, time)
        writer.writerow(cells.get(name.strip(), "") for name in header)
    return out.getvalue()


def _jointwise(rows: Sequence[Suggestion]) -> dict[str, NDArray[np.float64]]:
    """What the joints are to do (N, n), by the prefix of its columns; what no row has, left out."""
    import numpy as np

    named = {"q": "pose", "direction": "direction", "velocity": "velocity"}
    return {
        prefix: np.array([getattr(row, name) for row in rows], dtype=float)
        for prefix, name in named.items()
        if getattr(rows[0], name) is not None
    }


def _times(recording: Recording, found: NextExperiment) -> list[float]:
    """When the rows are due [s]: the usual step after the row before, and the rest; 0 untimed."""
    import numpy as np

    if recording.time is None:
        return [0.0] * len(found.rows)
    step = max(float(np.median(np.diff(recording.time))), 0.0)
    gaps = np.cumsum([step + (row.wait or 0.0) for row in found.rows])
    return [float(time) for time in recording.time.max() + gaps]


def _cells(row: Suggestion, time: float) -> dict[str, str]:
    """Cells of a row, but for those of joints, by the names of their columns."""
    cells = {"time": f"{time:.12g}", "held_out": "0"}
    if row.payload is not None:
        cells["payload"] = f"{row.payload:.6g}"
    whole = {"socket": row.socket, "group": row.group}
    return cells | {name: str(value) for name, value in whole.items() if value is not None}


def _print(recording: Recording, found: NextExperiment) -> None:
    from rich.console import Console

    from plumbline.optim.core.quantities import chance, counted

    console = Console(highlight=False)
    console.print(f"[bold]{recording.name}[/bold]: {counted(len(recording), 'row')} leave open")
    shared, labels = told_apart(found.explanations)
    if shared:
        console.print(f"  all     with {', '.join(shared)}", markup=False, soft_wrap=True)
    for letter, label, probability in zip(LETTERS, labels, found.probabilities, strict=False):
        console.print(f"  {letter}  {chance(probability):>6}  {label}", markup=False)
    if found.rows:
        table = _table(found)
        # Wider than the terminal rather than without the last joints.
        whole = console.options.update(width=WIDEST)
        wide = max(console.width, console.measure(table, options=whole).maximum)
        Console(highlight=False, width=wide).print("", table)
        console.print(_legend(found), markup=False)
    if found.forecast is not None:
        console.print(f"\n{_foreseen(found, found.forecast)}", markup=False)
    for note in found.notes:
        said = _lettered(note, found.explanations)
        console.print(f"• {said[0].upper()}{said[1:]}", markup=False)


def told_apart(explanations: Sequence[str]) -> tuple[list[str], list[str]]:
    """Causes that all explanations share, and of each what it has besides, in few words."""
    parts = [label.split(" and ") for label in explanations]
    if len(parts) < 2:
        return [], list(explanations)
    shared = [cause for cause in parts[0] if all(cause in other for other in parts)]
    own = [[cause for cause in causes if cause not in shared] for causes in parts]
    plus = "+ " if shared else ""
    few = ((*c[:NAMED], *([f"{len(c) - NAMED} more"] if len(c) > NAMED else [])) for c in own)
    return shared, [plus + " and ".join(causes) if causes else "nothing more" for causes in few]


def _lettered(words: str, explanations: Sequence[str]) -> str:
    """Words with letters in place of explanations, the longest first: one may hold another."""
    for label in sorted(explanations, key=len, reverse=True):
        letter = dict(zip(explanations, LETTERS, strict=False)).get(label)
        words = words.replace(label, letter) if letter and " and " in label else words
    return words


def _foreseen(found: NextExperiment, forecast: Forecast) -> str:
    from plumbline.optim.core.quantities import chance
    from plumbline.optim.diagnosis.constants import RANDOM_COUNTS

    leading = dict(zip(found.explanations, LETTERS, strict=False)).get(
        forecast.leading, "the first"
    )
    said = f"If {leading} is right: {chance(forecast.before)} -> {chance(forecast.after)}"
    if forecast.random is None:
        return f"{said}."
    many = forecast.random_rows
    as_many = f"about {many}" if many is not None else f"more than {RANDOM_COUNTS[-1]}"
    return f"{said}; as many rows at random {chance(forecast.random)} ({as_many} do as well)."


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
    unit = "rad" if "prismatic" not in found.kinds else "rad, m"
    heading = f"joints 1 to {len(found.kinds)} \\[{unit}; deg]"
    return {
        heading: posture,
        "side": "" if side is None else "".join(SIDES[s] for s in side),
        "wait": f"{row.wait:.0f} s" if row.wait else "",
        "payload": "" if row.payload is None else f"{row.payload:.3g} kg",
        "socket": "" if row.socket is None else str(row.socket),
        "tells": " from ".join(letters),
    }


def _padded(cells: Iterable[str]) -> str:
    return " ".join(f"{cell:>7}" for cell in cells)


def _legend(found: NextExperiment) -> str:
    said = ["tells: the two explanations above that the row does most to tell apart"]
    if found.rows[0].direction is not None:
        said.insert(0, "side: + reach the posture from below, - from above, joint by joint")
    if any(row.wait for row in found.rows):
        said.insert(-1, "wait: let the arm rest so long before the row")
    return "; ".join(said) + "."

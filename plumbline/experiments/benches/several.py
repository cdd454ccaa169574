"""Does one verdict on several recordings say more than a verdict on each?

``python -m plumbline.experiments.benches.several [--sessions N] [--rows N]``

*Drawn sessions.* One simulated arm with one cause, recorded three times: its tip in a surgical box
by one tracker, its pose there by another, its joints by second encoders, each with a device, tool
and postures of its own. A verdict is right if its causes are the truth alone, effect and element;
sure and wrong if it gives another one more than 0.95.

*A real arm.* Three series of a UR10, each asked alone and all together: what is left of the rows
that were left out.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from plumbline.experiments.benches import tell
from plumbline.experiments.benches.asking import SURE
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.reality import Plan, draw_case, simulate, write
from plumbline.experiments.reality.draws import draw
from plumbline.experiments.reality.gap import scaled
from plumbline.experiments.reality.recorder import Case
from plumbline.experiments.sources import fetch
from plumbline.optim.diagnosis.ask import diagnose
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording

ARM = "ur5"
KINDS = {"tips": "tip_position", "poses": "pose", "encoders": "joint_position"}
CAUSES = ("joint_scale", "joint_offset", "transmission_ripple", "joint_compliance", "sensor_scale")
GAP = 2.0  # unabsorbed gap of the cause in the tips, over their noise
ALL = "all together"
SERIES = ("ur10-grid", "ur10-joints", "ur10-iso")


@dataclass(frozen=True)
class Scored:
    """How often a way of asking is right."""

    asked: str
    sessions: int
    right: int
    sure_and_wrong: int
    seconds: float  # of one core, in the mean


@dataclass(frozen=True)
class Series:
    """One series, alone and together with the others [m]."""

    name: str
    rows: int
    before: float
    alone: float
    together: float
    without_it: float


@dataclass(frozen=True)
class Found:
    """All that was measured; names of the fields are the keys of the JSON."""

    seed: int
    drawn: tuple[Scored, ...]
    series: tuple[Series, ...]


def drawn_session(seed: int, folder: Path, rows: int = 100) -> tuple[list[Recording], str]:
    """Recordings of one arm with one cause, and the cause as a label."""
    rng = np.random.default_rng([seed, 11])
    sized = None
    while sized is None:
        name, first = str(rng.choice(CAUSES)), int(rng.integers(2**31))
        cases = [_case(k, told, first, rows) for k, told in enumerate(KINDS)]
        scene, target = cases[0].scene, GAP * cases[0].noise_std
        sized = scaled(scene, draw(name, scene, rng), target, KINDS["tips"])
    for case in cases:
        seen = case.name != "encoders" or name != "sensor_scale"
        at_work = replace(case, effects=(sized,), gap_to_noise=(GAP,)) if seen else case
        tables, _ = simulate(at_work)
        write(folder / case.name, tables)
    return [load_recording(folder / told) for told in KINDS], _label(name, sized.element)


def _case(k: int, told: str, first: int, rows: int) -> Case:
    """A recording of the arm in a surgical box, nothing wrong yet."""
    box = Plan(
        "none", rows=(rows, rows), observation=KINDS[told], arms=(ARM,), surgical=1.0, moving=0.0
    )
    return draw_case(box, told, first + k)


def _label(effect: str, element: int | None) -> str:
    return effect if element is None else f"{effect} {element}"


def scored(sessions: int, seed: int) -> tuple[Scored, ...]:
    """Each recording alone, and all of them."""
    tally: dict[str, list[tuple[bool, bool, float]]] = {name: [] for name in (*KINDS, ALL)}
    for k in range(sessions):
        with tempfile.TemporaryDirectory() as folder:
            parts, truth = drawn_session(seed + k, Path(folder))
        asked = [[part] for part in parts] + [parts]
        for name, which in zip(tally, asked, strict=True):
            begun = process_time()
            causes = diagnose(which, DiagnosisOptions(force=True)).causes
            seconds = process_time() - begun
            said = {_label(c.effect, c.element): c.probability for c in causes}
            wrong = any(p > SURE for label, p in said.items() if label != truth)
            tally[name].append((set(said) == {truth}, wrong, seconds))
    return tuple(_scored(name, all_of) for name, all_of in tally.items() if all_of)


def _scored(name: str, all_of: Sequence[tuple[bool, bool, float]]) -> Scored:
    right, wrong, seconds = zip(*all_of, strict=True)
    return Scored(name, len(all_of), sum(right), sum(wrong), float(np.mean(seconds)))


def series(rows: int) -> tuple[Series, ...]:
    """Each series of the UR10 alone, and all of them, on so many rows of each."""
    with tempfile.TemporaryDirectory() as folder:
        whole = [load_recording(fetch(name, Path(folder))) for name in SERIES]
    parts = [_thinned(r, rows) for r in whole]
    alone = [diagnose(part).gap.after for part in parts]
    together = diagnose(parts).verdict.recordings
    return tuple(
        Series(r.name, r.rows, r.before, one, r.after, r.without_it)
        for r, one in zip(together, alone, strict=True)
    )


def _thinned(recording: Recording, rows: int) -> Recording:
    count = len(recording)
    return recording.select(np.linspace(0, count - 1, min(rows, count)).astype(int))


def tables(found: Found) -> list[Table]:
    """Who is right, and what each series leaves."""
    who = Table("asked", "sessions", "right", "sure and wrong", "s of a core")
    for s in found.drawn:
        counts = (str(s.sessions), str(s.right), str(s.sure_and_wrong))
        who.add_row(s.asked, *counts, f"{s.seconds:.1f}")
    left = Table("series", "rows", "before", "alone", "together", "causes of the others alone")
    left.title = "RMS of rows left out [mm]"
    for one in found.series:
        sizes = (one.before, one.alone, one.together, one.without_it)
        left.add_row(one.name, str(one.rows), *(f"{1e3 * v:.3f}" for v in sizes))
    return [table for table in (who, left) if table.row_count]


def bench(
    sessions: Annotated[int, typer.Option(min=0, help="Drawn sessions.")] = 20,
    rows: Annotated[int, typer.Option(min=0, help="Rows of each UR10 series; 0: none.")] = 150,
    seed: Annotated[int, typer.Option(min=0, help="Of the first drawn session.")] = 0,
    json: Json = None,
) -> None:
    """Ask recordings one by one and all at once."""
    tell(lambda: Found(seed, scored(sessions, seed), series(rows) if rows else ()), tables, json)


if __name__ == "__main__":
    typer.run(bench)

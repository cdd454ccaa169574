r"""Many random tasks, one line of a table each: ``python -m experiments.campaign --count 10000``.

A task is drawn from its number alone, so a run that was interrupted goes on where its table ends,
and any line can be made again. Noise, lag, gain error and dead band of the plant are those that the
controller is told of, drawn anew for every task.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from experiments.closed_loop import Run, noise_for, run, statement_of
from experiments.commands import CommandError, Json, check_output, talks, write_json
from experiments.reality.theatre import FAMILIES, draw
from optim.capsule_mpc import Controller, Planner, RealTime, Safety, Settings
from optim.capsule_mpc.guide import Guide

HORIZON, V_MAX, BUDGET = 10, 60.0, 0.5  # steps; [mm/s]; [s], since a shared machine may pause
COLUMNS = ("number", "family", "seed", "clearance", "reached", "steps", "p50", "p99", "most")


@dataclass(frozen=True)
class Line:
    """One task's outcome.

    Attributes:
        number: Of the task.
        family: Its family.
        seed: What it was drawn from.
        clearance: Least clearance by coal [mm].
        reached: Whether all goals were reached.
        steps: Steps made.
        p50: Median time of a step [ms].
        p99: Its 99th percentile [ms].
        most: Its maximum [ms].
    """

    number: int
    family: str
    seed: int
    clearance: float
    reached: bool
    steps: int
    p50: float
    p99: float
    most: float


def task(
    number: int,
    seed: int,
    planner: Planner | None = None,
    guided: bool = True,
    most: int = 600,
) -> Run:
    """Run the task of a number, for so many steps at most; families take turns."""
    family = list(FAMILIES)[number % len(FAMILIES)]
    scenario = draw(family, 100_000 * seed + number // len(FAMILIES))
    settings = Settings(p=HORIZON, noise=noise_for(scenario.mismatch, V_MAX))
    statement = statement_of(scenario, settings, V_MAX)
    own = planner or RealTime(compiled=False)
    controller = Controller(statement, own, Safety(budget=BUDGET))
    return run(scenario, controller, Guide(statement) if guided else None, most)


def line_of(number: int, found: Run) -> Line:
    """What is kept of a run."""
    p50, p99, most = 1e3 * np.percentile(found.seconds, [50.0, 99.0, 100.0])
    return Line(
        number,
        found.family,
        found.seed,
        found.clearance,
        found.reached,
        found.steps,
        float(p50),
        float(p99),
        float(most),
    )


def read(path: Path) -> list[Line]:
    """The lines of a table; one that was cut short by an interruption is left out."""
    if not path.exists():
        return []
    found = []
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if all(row.get(column) not in (None, "") for column in COLUMNS):
                found.append(_parsed(row))
    return found


def _parsed(row: dict[str, str]) -> Line:
    whole = [int(row[name]) for name in ("number", "seed", "steps")]
    times = [float(row[name]) for name in ("p50", "p99", "most")]
    number, seed, steps = whole
    reached = row["reached"] == "True"
    return Line(number, row["family"], seed, float(row["clearance"]), reached, steps, *times)


def go_on(path: Path, count: int, seed: int) -> Iterator[Line]:
    """Run what the table lacks of the first ``count`` tasks, and write each line at once."""
    done = {line.number for line in read(path)}
    fresh = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        if fresh:
            writer.writerow(COLUMNS)
        elif not path.read_text(encoding="utf-8").endswith("\n"):
            file.write("\n")
        for number in range(count):
            if number not in done:
                line = line_of(number, task(number, seed))
                writer.writerow([getattr(line, name) for name in COLUMNS])
                file.flush()
                yield line


def table(lines: Sequence[Line]) -> Table:
    """The outcome, family by family."""
    heads = ("family", "tasks", "collisions", "least clearance", "goals reached", "p50", "p99")
    drawn = Table(*heads, title="Random tasks, clearances by coal")
    for family in [*FAMILIES, "all"]:
        own = [line for line in lines if family in ("all", line.family)]
        if own:
            drawn.add_row(family, *words(own))
    return drawn


def words(lines: Sequence[Line]) -> tuple[str, ...]:
    """Cells of a row: tasks, collisions, least clearance, goals reached, times."""
    least = min(line.clearance for line in lines)
    return (
        f"{len(lines):,}",
        f"{sum(line.clearance < 0.0 for line in lines)}",
        f"{least:.3f} mm",
        f"{100 * np.mean([line.reached for line in lines]):.2f} %",
        f"{np.median([line.p50 for line in lines]):.2f} ms",
        f"{np.median([line.p99 for line in lines]):.2f} ms",
    )


def campaign(
    count: Annotated[int, typer.Option(min=1, help="Tasks in all.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    out: Annotated[Path, typer.Option(help="The table, which is continued.")] = Path("mpc.csv"),
    json: Json = None,
) -> None:
    """Run random tasks, or go on with them, and print what came of them."""
    try:
        check_output(json, "--json")
        check_output(out, "--out")
        for line in go_on(out, count, seed):
            if line.number % 100 == 99:
                typer.echo(f"{line.number + 1} tasks", err=True)
        lines = [line for line in read(out) if line.number < count]
        least = min(line.clearance for line in lines)
        hits = sum(line.clearance < 0.0 for line in lines)
        share = float(np.mean([line.reached for line in lines]))
        figures = {"collisions": hits, "min_clearance": least, "goals_reached": share}
        write_json(json, {"scenarios": len(lines), **figures})
    except CommandError as error:
        typer.echo(f"campaign: {error}", err=True)
        raise typer.Exit(2) from None
    if talks(json, quiet=False):
        Console(highlight=False).print(table(lines))


if __name__ == "__main__":
    typer.run(campaign)

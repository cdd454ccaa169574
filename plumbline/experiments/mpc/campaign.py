r"""Many random tasks, a line of a table for each.

``python -m plumbline.experiments.mpc.campaign --count 10000``

A task is drawn from its number alone, so a run that was interrupted goes on where its table ends,
and any line can be made again. Noise, lag, gain error and dead band of the plant are those that the
controller is told of, drawn anew for every task. Each task is done by every controller that is
asked for: the horizon, and one step on control barrier functions, the same guide before both.

The plant moves a millisecond at a time, and every millisecond is judged, over the whole shafts.
Where arithmetic finds a pair nearest, in contact, or at a moment chosen beforehand, coal is asked;
see :mod:`plumbline.experiments.reality.touch`.
"""

import csv
import fcntl
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from plumbline.errors import PlumblineError, fault
from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.console.outputs import check_output
from plumbline.experiments.console.workers import done_by
from plumbline.experiments.mpc.closed_loop import Run, known_delay, noise_for, run, statement_of
from plumbline.experiments.reality.mpc_scenarios import FAMILIES, draw
from plumbline.experiments.reality.task import Scenario
from plumbline.optim.capsule_mpc import Controller, OneStep, Planner, RealTime, Safety, Settings
from plumbline.optim.capsule_mpc.waypoints import Guide

HORIZON, V_MAX, BUDGET = 10, 60.0, 0.5  # steps; [mm/s]; [s], since a shared machine may pause
CONTROLLERS: dict[str, Planner] = {"horizon": RealTime(), "one step": OneStep()}


@dataclass(frozen=True)
class Line:
    """One task's outcome with one controller."""

    number: int  # of the task
    family: str  # its family
    seed: int  # what it was drawn from
    controller: str  # who did it
    clearance: float  # least clearance at every millisecond [mm]
    at_steps: float  # least clearance at the controller's samples [mm]
    # the most by which a tip stood above the plane of its trocar [mm]; negative below
    height: float
    reached: bool  # whether all goals were reached
    steps: int  # steps made
    p50: float  # median of the processor time of a step [ms]
    p99: float  # its 99th percentile [ms]
    most: float  # its maximum [ms]


COLUMNS = tuple(field.name for field in fields(Line))
OF_RUN = ("family", "seed", "clearance", "at_steps", "height", "reached", "steps")


drawn = lru_cache(maxsize=4)(draw)  # controllers do the same task one after the other


def task(
    number: int, seed: int, planner: Planner | None = None, guided: bool = True, most: int = 600
) -> Run:
    """Run the task of a number, for so many steps at most; families take turns."""
    family = list(FAMILIES)[number % len(FAMILIES)]
    scenario = drawn(family, 100_000 * seed + number // len(FAMILIES))
    return done(scenario, planner or RealTime(compiled=False), guided, most)


def done(scenario: Scenario, planner: Planner, guided: bool, most: int = 600) -> Run:
    """Do a task with a planner, behind the guide or without it."""
    settings = Settings(p=HORIZON, noise=noise_for(scenario.mismatch, V_MAX))
    statement = statement_of(scenario, settings, V_MAX)
    safety = Safety(budget=BUDGET, delay=known_delay(scenario.mismatch))
    controller = Controller(statement, planner, safety)
    return run(scenario, controller, Guide(statement) if guided else None, most)


def line_of(number: int, controller: str, found: Run) -> Line:
    """What is kept of a run."""
    p50, p99, most = (1e3 * np.percentile(found.seconds, [50.0, 99.0, 100.0])).tolist()
    of_run = {name: getattr(found, name) for name in OF_RUN}
    return Line(number=number, controller=controller, **of_run, p50=p50, p99=p99, most=most)


def read(path: Path) -> list[Line]:
    """The lines of a table; one that was cut short, or written again, is left out.

    Raises:
        PlumblineError: A table with other columns.
    """
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        if tuple(rows.fieldnames or COLUMNS) != COLUMNS:
            raise PlumblineError(f"{path}: other columns than {', '.join(COLUMNS)}; name another")
        whole = (row for row in rows if all(row[name] not in (None, "") for name in COLUMNS))
        first: dict[tuple[int, str], Line] = {}
        for line in map(_parsed, whole):
            first.setdefault((line.number, line.controller), line)
        return list(first.values())


def _parsed(row: dict[str, str]) -> Line:
    kinds: dict[Any, Callable[[str], Any]] = {int: int, float: float, str: str, bool: "True".__eq__}
    return Line(**{f.name: kinds[f.type](row[f.name]) for f in fields(Line)})


def _made(seed: int, asked: tuple[int, list[str]]) -> list[Line]:
    number, names = asked
    return [line_of(number, name, task(number, seed, CONTROLLERS[name])) for name in names]


def go_on(
    path: Path,
    count: int,
    seed: int,
    controllers: Sequence[str] = tuple(CONTROLLERS),
    jobs: int = 1,
) -> Iterator[Line]:
    """Run what the table lacks of the first ``count`` tasks, and write each line at once.

    Raises:
        PlumblineError: Another campaign writes the table.
    """
    with path.open("a", encoding="utf-8", newline="") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            mend = "wait for it, or name another --out"
            raise fault(str(path), "a campaign at work", "this one alone", mend) from None
        writer = csv.writer(file)
        if not path.stat().st_size:
            writer.writerow(COLUMNS)
        elif not path.read_text(encoding="utf-8").endswith("\n"):
            file.write("\n")
        done = {(line.number, line.controller) for line in read(path)}
        wanted = (
            (number, [name for name in controllers if (number, name) not in done])
            for number in range(count)
        )
        for line in _lines([task for task in wanted if task[1]], seed, jobs):
            writer.writerow([getattr(line, name) for name in COLUMNS])
            file.flush()
            yield line


def _lines(missing: list[tuple[int, list[str]]], seed: int, jobs: int) -> Iterator[Line]:
    for lines in done_by(partial(_made, seed), missing, jobs):
        yield from lines


def table(lines: Sequence[Line]) -> pd.DataFrame:
    """The outcome, family by family and controller by controller."""
    return pd.DataFrame([
        {"family": family, "controller": name, **of_lines(own)}
        for family in (*FAMILIES, "all") for name in CONTROLLERS
        if (own := [x for x in lines if family in ("all", x.family) and x.controller == name])
    ])  # fmt: skip


def of_lines(lines: Sequence[Line]) -> dict[str, float]:
    """Tasks, contacts, clearances and height [mm], goals reached, times of a step [ms]."""
    return {
        "scenarios": len(lines),
        "contacts": sum(line.clearance < 0.0 for line in lines),
        "min_clearance": min(line.clearance for line in lines),
        "min_clearance_at_steps": min(line.at_steps for line in lines),
        "max_height": max(line.height for line in lines),
        "goals_reached": float(np.mean([line.reached for line in lines])),
        "p50": float(np.median([line.p50 for line in lines])),
        "p99": float(np.median([line.p99 for line in lines])),
    }


def figures(lines: Sequence[Line]) -> dict[str, dict[str, float]]:
    """The same by controller."""
    own = {name: [x for x in lines if x.controller == name] for name in CONTROLLERS}
    return {name: of_lines(some) for name, some in own.items() if some}


def _known(names: list[str]) -> list[str]:
    unknown = [name for name in names if name not in CONTROLLERS]
    if unknown:
        raise PlumblineError(
            f"--controller: found {unknown[0]!r}, expected {' or '.join(map(repr, CONTROLLERS))}"
        )
    return names


@as_command
def campaign(
    count: Annotated[int, typer.Option(min=1, help="Tasks in all.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    out: Annotated[Path, typer.Option(help="The table, which is continued.")] = Path("mpc.csv"),
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    controller: Annotated[list[str] | None, typer.Option(help="Who does them; all do.")] = None,
) -> Found:
    """Run random tasks, or go on with them, and print what came of them."""
    check_output(out, "--out", overwrite=True)
    names = _known(controller or list(CONTROLLERS))
    for line in go_on(out, count, seed, names, jobs):
        if line.number % 100 == 99 and line.controller == names[-1]:
            typer.echo(f"{line.number + 1} tasks", err=True)
    lines = [line for line in read(out) if line.number < count]
    return {"random tasks, judged at every ms": table(lines), **figures(lines)}


if __name__ == "__main__":
    typer.run(campaign)

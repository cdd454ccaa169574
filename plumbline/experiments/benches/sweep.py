"""A sweep on two processes against one: ``python -m plumbline.experiments.benches.sweep``.

The same cases, of few rows of the bundled recording, by ``plumbline sweep --jobs 1`` and by
``--jobs 2``; the second is killed twice on its way and called again. Hoped for: 1.8 times faster,
every case there once, and both tables the same. Seconds are of the wall: ask a quiet machine.
"""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from time import perf_counter, sleep
from typing import Annotated

import typer
from rich.table import Table

from plumbline.experiments.benches import tell
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.sweep.cases import SUFFIX

RECORDING = Path(str(files("plumbline.experiments"))) / "recordings" / "bench-ur5"
ROWS, KILLS, LEAST_FASTER = 20, (1 / 3, 2 / 3), 1.8


@dataclass(frozen=True)
class Raced:
    """All that was measured; names of the fields are the keys of the JSON."""

    cases: int  # how many
    one: float  # by one process [s]
    two: float  # by two, without a kill [s]
    times: float  # how many times faster
    killed: int  # processes that were killed before the third sweep ended
    lost: int  # cases that are in the first table and not in the third
    doubled: int  # cases that are there more than once
    other: int  # cases of which a table says otherwise than the first


def measured(cases: int) -> Raced:
    """One process, two, and two that are killed."""
    with tempfile.TemporaryDirectory(prefix="plumbline-sweep-") as scratch:
        spec, home = Path(scratch) / "spec.toml", Path(scratch)
        vary = f"seed = {list(range(cases))}\nrows = [{ROWS}]"
        spec.write_text(f'recording = "{RECORDING}"\n[vary]\n{vary}\n', encoding="utf-8")
        one = swept(spec, home / "one.csv", jobs=1)
        two = swept(spec, home / "two.csv", jobs=2)
        killed = sum(_killed(spec, home / "three.csv", int(share * cases)) for share in KILLS)
        swept(spec, home / "three.csv", jobs=2)
        first, second, third = (rows_of(home / f"{name}.csv") for name in ("one", "two", "three"))
        asked = [row["seed"] for row in third]
        other = sum(a not in second or a not in third for a in first)
        lost = {row["seed"] for row in first} - set(asked)
        doubled = len(asked) - len(set(asked))
        return Raced(cases, one, two, one / two, killed, len(lost), doubled, other)


def command(spec: Path, out: Path, jobs: int) -> list[str]:
    """The sweep as it is called."""
    asked = ["sweep", str(spec), "--csv", str(out), "--jobs", str(jobs), "--quiet"]
    return [sys.executable, "-m", "plumbline", *asked]


def swept(spec: Path, out: Path, *, jobs: int) -> float:
    """Seconds of a whole sweep."""
    begun = perf_counter()
    subprocess.run(command(spec, out, jobs), check=True)
    return perf_counter() - begun


def _killed(spec: Path, out: Path, after: int) -> bool:
    """Kill a sweep by two, with its workers, once so many are kept; whether it came to that."""
    kept = out.with_name(out.name + SUFFIX)
    with subprocess.Popen(command(spec, out, 2), start_new_session=True) as process:
        while process.poll() is None:
            if kept.exists() and len(kept.read_bytes().splitlines()) > after:
                os.killpg(process.pid, signal.SIGKILL)
                return True
            sleep(0.05)
    return False


def rows_of(out: Path) -> list[dict[str, str]]:
    """The table that a sweep wrote."""
    return list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))


def tables(found: Raced) -> list[Table]:
    """What was measured, with what is hoped for."""
    table = Table("cases", "one process", "two", "times", "killed", "lost", "doubled", "other")
    counts = (found.killed, found.lost, found.doubled, found.other)
    seconds = (f"{found.one:.1f} s", f"{found.two:.1f} s", f"{found.times:.2f}")
    table.add_row(f"{found.cases:,}", *seconds, *map(str, counts))
    table.caption = f"hoped for: at least {LEAST_FASTER:g} times, {len(KILLS)} killed, nothing lost"
    return [table]


def bench(
    cases: Annotated[int, typer.Option(min=6, help="Cases of each sweep.")] = 1000,
    json: Json = None,
) -> None:
    """Time a sweep by two processes against one; kill it twice and see that nothing is lost."""
    tell(lambda: measured(cases), tables, json)


if __name__ == "__main__":
    typer.run(bench)

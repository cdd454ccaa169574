"""One way in an environment and a process of its own, and the page of what all ways came to.

A cell that stays empty says why.
"""

import json
import os
import subprocess
import sys
import venv
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.experiments.compare.contests import OURS, Contest, Given, Way

PEERS = Path(__file__).parent / "peers"
PATIENCE = 1200.0  # [s] of one way; of making an environment too
STAMP = "needs.txt"  # in an environment: what it was made of
HEAD = """\
# Beside the peers

Written by `make compare` (`python -m plumbline.experiments.compare`) on {day}: each way in an
environment and a process of its own, on the same data, on {machine}. Seconds are the
processor's: of the first call, in which plumbline compiles its symbols, and the least of three
after it. Memory is the largest that the process had, imports included; plumbline's imports alone
take {floor:.0f} MB. What could not be run says why.
"""
COLUMNS = ("peer", "version", "figure", "first [s]", "again [s]", "memory [MB]", "note")


@dataclass(frozen=True)
class Cell:
    """What one way did."""

    contest: str  # of which contest
    peer: str  # whose way
    version: str = ""  # of the peer
    # the figure that is compared, in the contest's unit; None where there is none
    error: float | None = None
    first: float | None = None  # processor time of the first call [s]
    seconds: float | None = None  # least processor time of the calls after it [s]
    memory: int | None = None  # largest memory of the process [byte]
    figures: dict[str, float] = field(default_factory=dict)  # further figures
    why: str = ""  # why the cell is empty; empty where it is not
    note: str = ""  # what differs from the others

    @property
    def words(self) -> str:
        """What was found, on a line."""
        said = self.why or ("nothing" if self.error is None else f"{self.error:.4g}")
        if self.seconds is not None and self.memory is not None:
            said += f", {self.seconds:.3g} s, {self.memory / 1e6:.0f} MB"
        return f"{self.contest:<14} {self.peer:<14} {said}"

    def to_dict(self) -> dict[str, Any]:
        """As plain data in SI units, but for the figures' own."""
        return asdict(self)


class EmptyCellError(Exception):
    """Why a way gave nothing, in a line."""


def cell(contest: Contest, way: Way, given: Path, build: Path) -> Cell:
    """Run one way; what goes wrong there is what the cell says."""
    try:
        found = _run(environment(build, way), way, contest.subject, given)
    except EmptyCellError as empty:
        return Cell(contest.name, way.peer, why=str(empty), note=way.note)
    own = dict(found["figures"])
    error = own.pop("error", None)
    used = {} if contest.is_time else {k: found[k] for k in ("first", "seconds", "memory")}
    return Cell(contest.name, way.peer, found["version"], error, figures=own, note=way.note, **used)


def environment(build: Path, way: Way) -> Path:
    """The interpreter that a way needs, its environment made if need be (EmptyCellError)."""
    if not way.needs:
        return Path(sys.executable)
    folder = build / way.peer.lower().replace(".", "-")
    python, stamp = folder / "bin" / "python", folder / STAMP
    wanted = "\n".join(way.needs)
    if stamp.exists() and stamp.read_text(encoding="utf-8") == wanted:
        return python
    venv.create(folder, with_pip=True, clear=True)
    _called([str(python), "-m", "pip", "install", "-q", *way.needs])
    stamp.write_text(wanted, encoding="utf-8")
    return python


def _run(python: Path, way: Way, subject: str, given: Path) -> dict[str, Any]:
    said = _called([str(python), str(PEERS / "run.py"), way.module, subject, str(given)])
    found: dict[str, Any] = json.loads(said.strip().splitlines()[-1])
    return found


def _called(command: list[str]) -> str:
    alone = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=PATIENCE,
            env=os.environ | alone,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise EmptyCellError(f"took longer than {PATIENCE:g} s") from None
    except subprocess.CalledProcessError as error:
        lines = [line for line in error.stderr.strip().splitlines() if line.strip()]
        why = lines[-1].strip()[:200] if lines else f"ended {error.returncode}"
        raise EmptyCellError(why) from None
    return done.stdout


def written(given: Given, path: Path) -> Path:
    """Data as a file that every environment reads."""
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in given.items()}
    np.savez(path, **arrays)
    return path


def page(
    contests: Sequence[Contest], cells: Sequence[Cell], *, day: date, machine: str, floor: float
) -> str:
    """The page in Markdown: on which day and machine, our imports alone taking ``floor`` [MB]."""
    parts = [HEAD.format(day=day.isoformat(), machine=machine, floor=floor)]
    for contest in contests:
        own = [c for c in cells if c.contest == contest.name]
        if not own:
            continue
        parts.append(f"## {contest.name.capitalize().replace('Dh', 'DH')}\n")
        parts.append(f"{contest.what[:1].upper()}{contest.what[1:]}; {contest.figure}.\n")
        rows = [COLUMNS, ("---",) * len(COLUMNS), *(_row(c) for c in own)]
        parts.append("\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n")
        parts.append(verdict(own) + "\n")
    return "\n".join(parts)


def verdict(cells: Sequence[Cell]) -> str:
    """What we win and what we lose, peer by peer, in plain words."""
    ours = next((c for c in cells if c.peer == OURS), None)
    if ours is None or ours.error is None:
        return "Nothing of ours to compare."
    said = []
    for other in cells:
        if other.peer == OURS:
            continue
        if other.why or other.error is None:
            said.append(f"{other.peer}: not compared.")
            continue
        won: list[str] = []
        lost: list[str] = []
        for name, a, b in (
            ("figure", ours.error, other.error),
            ("first call", ours.first, other.first),
            ("time", ours.seconds, other.seconds),
            ("memory", ours.memory, other.memory),
        ):
            ratio = _ratio(b, a)
            if ratio is not None:
                (won if ratio >= 1 else lost).append(f"{name} {_times(ratio)}")
        words = [f"we win {', '.join(won)}"] if won else []
        words += [f"we lose {', '.join(lost)}"] if lost else []
        said.append(f"{other.peer}: {'; '.join(words)}.")
    return " ".join(said)


def _row(c: Cell) -> tuple[str, ...]:
    if c.why:
        return (c.peer, c.version or "-", "-", "-", "-", "-", f"not run: {c.why}")
    figure = "-" if c.error is None else f"{c.error:.4g}"
    times = ("-" if t is None else f"{t:.3g}" for t in (c.first, c.seconds))
    memory = "-" if c.memory is None else f"{c.memory / 1e6:.0f}"
    return (c.peer, c.version, figure, *times, memory, c.note)


def _ratio(theirs: float | None, mine: float | None) -> float | None:
    """Theirs over ours; None where a number is missing or next to nothing."""
    if theirs is None or mine is None or min(theirs, mine) <= 0.0:
        return None
    return theirs / mine


def _times(ratio: float) -> str:
    more = max(ratio, 1 / ratio)
    return "by nothing" if more < 1.005 else f"by {more:.3g} times"

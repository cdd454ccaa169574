"""One way in an environment and a process of its own; a cell that stays empty says why."""

import json
import os
import subprocess
import sys
import venv
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.experiments.compare.contests import Contest, Given, Way

PEERS = Path(__file__).parent / "peers"
PATIENCE = 1200.0  # [s] of one way; of making an environment too
STAMP = "needs.txt"  # in an environment: what it was made of


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
    """The interpreter that a way needs; its environment is made where there is none.

    Raises:
        EmptyCellError: It cannot be made; the installer's last word says why.
    """
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

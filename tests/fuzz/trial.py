"""One damaged recording through one command: what came of it, and what broke.

A command ends in time with 0 and JSON without a NaN, or with 2 and one printable line; it writes
nothing into the recording. Anything else is a break.
"""

from __future__ import annotations

import io
import json
import signal
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from plumbline.experiments.commands.app import INTERRUPTED, run
from tests.fuzz.damage import ANYWHERE, ODD_FILES, OWN
from tests.fuzz.recordings import KINDS, sound

SECONDS = 10.0  # [s]: a command that takes longer hangs
LONGEST = 700  # characters of the line with which a recording is refused
ODD = 0.08  # share of damages that leave no file at all


@dataclass(frozen=True)
class Trial:
    """What came of one damaged recording."""

    number: int  # which one; it follows from the seed and this
    kind: str  # of recording
    damages: tuple[str, ...]  # what was done to it, in turn
    code: int  # exit code; -1 where there was none
    broke: str  # what broke, in one line; empty if nothing did
    seconds: float  # time taken [s]


class OverdueError(BaseException):
    """It took too long; no handler of errors may take it for one."""


def trial(number: int, seed: int, command: str = "check", seconds: float = SECONDS) -> Trial:
    """Damage a recording and run a command on it.

    Args:
        number: Which one.
        seed: Of all that is drawn.
        command: The command; it takes a folder and ``--json``.
        seconds: How long it may take [s].
    """
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    with TemporaryDirectory(prefix="plumbline-fuzz-") as scratch:
        folder = Path(scratch) / "recording"
        done = damaged(folder, kind, rng)
        before = _listing(folder)
        begun = perf_counter()
        code, broke = _judged(command, folder, Path(scratch) / "out.json", seconds)
        if not broke and _listing(folder) != before:
            broke = "the recording's folder was written into"
        return Trial(number, kind, done, code, broke, perf_counter() - begun)


def damaged(folder: Path, kind: str, rng: np.random.Generator) -> tuple[str, ...]:
    """Write a recording of a kind and damage it once to three times; what was done, in words."""
    folder.mkdir()
    files = {name: text.encode() for name, text in sound(kind).items()}
    names, done, gone = sorted(files), [], set()
    for _ in range(rng.integers(1, 4)):
        name = names[rng.integers(len(names))]
        if rng.random() < ODD:
            odd = list(ODD_FILES)[rng.integers(len(ODD_FILES))]
            if name not in gone:
                ODD_FILES[odd](folder / name)
                done.append(f"{name}: {odd}")
            gone.add(name)
            continue
        # A file's own damages are as likely as those that any file may take.
        pool = OWN[name] if rng.random() < 0.5 else ANYWHERE
        change = pool[rng.integers(len(pool))]
        files[name] = change(files[name], rng)
        done.append(f"{name}: {change.__name__}")
    for name, data in files.items():
        if name not in gone:
            (folder / name).write_bytes(data)
    return tuple(done)


def _judged(command: str, folder: Path, out: Path, seconds: float) -> tuple[int, str]:
    """The exit code, and what broke."""
    words, said = io.StringIO(), io.StringIO()
    try:
        with _in_time(seconds), redirect_stdout(words), redirect_stderr(said):
            code = run([command, str(folder), "--json", str(out)])
    except OverdueError:
        return -1, f"hangs: no end after {seconds:g} s"
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}:{last.lineno}"
        return -1, f"traceback: {type(error).__name__} at {where}: {str(error)[:200]!r}"
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    return code, _wrong(code, words.getvalue(), said.getvalue(), out)


def _wrong(code: int, words: str, said: str, out: Path) -> str:
    if code == 0:
        return _not_finite(out) or ("" if words.strip() else "no words")
    if code != 2:
        return f"exit code {code}"
    if not (said.startswith("plumbline: ") and said.count("\n") == 1 and said.endswith("\n")):
        return f"not one line: {said[:200]!r}"
    if not said[:-1].isprintable() or len(said) > LONGEST:
        return f"a line of {len(said)} characters: {said[:200]!r}"
    return "words beside a refusal" if words else ""


def _not_finite(out: Path) -> str:
    found: list[str] = []
    try:
        json.loads(out.read_text(encoding="utf-8"), parse_constant=found.append)
    except (OSError, ValueError) as error:
        return f"no JSON: {error}"
    return f"{found[0]} in the JSON" if found else ""


def _listing(folder: Path) -> list[tuple[str, int, int]]:
    found = [(path.name, path.lstat()) for path in sorted(folder.iterdir())]
    return [(name, stat.st_size, stat.st_mtime_ns) for name, stat in found]


@contextmanager
def _in_time(seconds: float) -> Iterator[None]:
    """Raise inside what takes longer; only a main thread can be told to."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: object) -> None:
        raise OverdueError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)

"""How the benches of the diagnosis ask it, and what they read in its answer: the verdict's JSON."""

import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import typer

from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.reality.recorder import Recording as Tables
from plumbline.experiments.reality.recorder import write
from plumbline.experiments.sources import fetch
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording

Verdict = Mapping[str, Any]
Asked = Callable[[Recording], Verdict]
T = TypeVar("T")
# Probabilities from which a cause is there, or is not: as a verdict has them.
SURE, RULED_OUT = 0.95, 0.05


def asking(seed: int) -> Asked:
    """The library's own diagnosis, with the seed of all that it draws."""
    options = DiagnosisOptions(seed=seed, force=True)
    return lambda recording: diagnose(recording, options).verdict.to_dict()


def run_bench(found: Callable[[Asked, int, int], Found], words: str, arms: int) -> None:
    """Run a bench of drawn arms as a command: so many by default, and these words as its help."""

    @as_command
    def bench(
        count: Annotated[int, typer.Option(min=1, help="Arms, of each kind if there are.")] = arms,
        seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    ) -> Found:
        return found(asking(seed), count, seed)

    bench.__doc__ = words
    typer.run(bench)


def key_of(cause: Mapping[str, Any]) -> Key:
    """Effect and element of what a verdict lists."""
    return str(cause["effect"]), cause["element"]


def label(key: Key) -> str:
    """An effect with its element's number."""
    return key[0] if key[1] is None else f"{key[0]} {key[1]}"


def probability_of(verdict: Verdict, key: Key) -> float:
    """The largest probability that a verdict gives an effect at an element; 0 if it lists none."""
    listed = (*verdict["causes"], *verdict.get("candidates", ()))
    return max((float(c["probability"]) for c in listed if key_of(c) == key), default=0.0)


def surest(verdict: Verdict) -> float:
    """Probability of the surest statement that anything is wrong."""
    causes = [float(cause["probability"]) for cause in verdict["causes"]]
    return max([*causes, float(verdict.get("outside_probability") or 0.0)])


def loaded(tables: Tables) -> Recording:
    """A simulated recording as a user would load it: by way of its files."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), tables)
        return load_recording(Path(folder))


def fetched(names: Iterable[str]) -> list[Recording]:
    """Public recordings by their names."""
    with tempfile.TemporaryDirectory() as folder:
        return [load_recording(fetch(name, Path(folder))) for name in names]


def thinned(recording: Recording, rows: int) -> Recording:
    """At most so many rows, evenly; all of them for 0."""
    if not rows or len(recording) <= rows:
        return recording
    return recording.select(np.linspace(0, len(recording) - 1, rows).round().astype(int))


def counted(things: Sequence[T], words: str) -> Iterator[T]:
    """The things one by one; says on standard error which one is at hand.

    On a terminal in one line that changes, in a file in a line each.
    """
    shows = sys.stderr is not None
    before, after = ("\r", " ") if shows and sys.stderr.isatty() else ("", "\n")
    for number, thing in enumerate(things, start=1):
        if shows:
            said = f"{before}{words} {number} of {len(things)}"
            print(said, end=after, file=sys.stderr, flush=True)
        yield thing
    if shows and before:
        print(file=sys.stderr)

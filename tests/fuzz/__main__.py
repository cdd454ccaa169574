"""Damaged recordings by the thousand.

``python -m tests.fuzz --count 10000``

``recordings`` makes sound ones of every kind, ``damage`` damages them once to three times,
``trial`` runs ``plumbline check`` on one within this process: no traceback, no hang, no NaN,
nothing written into a recording. A recording follows from the seed and its number, so that one
that breaks can be made again: ``--first NUMBER --count 1``.
"""

from __future__ import annotations

import faulthandler
import secrets
import sys
from collections import Counter
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from plumbline.experiments.console.measured import tell
from plumbline.experiments.console.outputs import Json
from tests.fuzz.recordings import KINDS
from tests.fuzz.trial import SECONDS, Trial, trial

SHOWN = 20  # breaks that are printed; all are in the JSON


@dataclass(frozen=True)
class Kind:
    """What came of the recordings of one kind."""

    kind: str
    recordings: int
    read: int
    refused: int
    broke: int
    slowest: float


@dataclass(frozen=True)
class Fuzzed:
    """All that was found; names of the fields are the keys of the JSON."""

    seed: int
    first: int
    command: str
    kinds: tuple[Kind, ...]
    damages: dict[str, int]
    broke: tuple[Trial, ...]


def fuzzed(first: int, count: int, seed: int, command: str, seconds: float) -> Fuzzed:
    """Run so many recordings."""
    trials = []
    for number in range(first, first + count):
        trials.append(trial(number, seed, command, seconds))
        if trials[-1].broke or number % 1000 == 999:
            print(f"{number + 1}: {trials[-1].broke or 'all well'}", file=sys.stderr)
    damages = Counter(words for t in trials for words in t.damages)
    broke = tuple(t for t in trials if t.broke)
    return Fuzzed(seed, first, command, _kinds(trials), dict(sorted(damages.items())), broke)


def _kinds(trials: list[Trial]) -> tuple[Kind, ...]:
    found = []
    for kind in [*KINDS, "all"]:
        own = [t for t in trials if kind in ("all", t.kind)]
        read, refused = (sum(t.code == code and not t.broke for t in own) for code in (0, 2))
        slowest = float(np.max([t.seconds for t in own], initial=0.0))
        broke = sum(bool(t.broke) for t in own)
        found.append(Kind(kind, len(own), read, refused, broke, slowest))
    return tuple(found)


def tables(found: Fuzzed) -> dict[str, pd.DataFrame]:
    """What came of them, and what broke."""
    words = f"damaged recordings through {found.command}, seed {found.seed}"
    told = {words: pd.DataFrame(found.kinds)}
    return told | ({"broke": pd.DataFrame(found.broke)} if found.broke else {})


def bench(
    count: Annotated[int, typer.Option(min=1, help="Recordings in all.")] = 1000,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of all that is drawn; a fresh one if not given.")
    ] = None,
    first: Annotated[int, typer.Option(min=0, help="Number of the first.")] = 0,
    command: Annotated[str, typer.Option(help="check, or another that reads a folder.")] = "check",
    seconds: Annotated[float, typer.Option(min=0.1, help="What one may take [s].")] = SECONDS,
    json: Json = None,
) -> None:
    """Damage recordings and see whether anything breaks; exit 1 if something does."""
    broken: list[Trial] = []

    def measure() -> dict[str, pd.DataFrame]:
        given = secrets.randbits(32) if seed is None else seed
        print(f"seed {given}", file=sys.stderr)
        found = fuzzed(first, count, given, command, seconds)
        broken.extend(found.broke)
        return tables(found)

    tell(measure, json)
    if broken:
        raise typer.Exit(1)


if __name__ == "__main__":
    faulthandler.enable()  # where even the process breaks, its last words name the place
    typer.run(bench)

r"""Does the same robot, recorded again, get the same answer?

``python -m plumbline.experiments.benches.consistency [--robot ur10] [--rows N]``

Recordings of one robot in pairs, and both halves of each long one. For every parameter that both
verdicts of a pair state, of the same effect, element and variant,

.. math:: z = (a - b) / \sqrt{s_a^2 + s_b^2},

whose root mean square is 1 where the stated errors hold from one recording to the next. A cause
*comes and goes* if it has more than .95 in one and less than .05 in the other, although the other
could show it; where the other says that it cannot tell it from what it names, that is said apart.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from plumbline.errors import PlumblineError, best_matches, fault
from plumbline.experiments.benches import tell
from plumbline.experiments.benches.asking import (
    RULED_OUT,
    SURE,
    Asked,
    Verdict,
    asking,
    counted,
    key_of,
    probability_of,
)
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.sources import fetch, list_sources
from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording

ROBOTS = {
    "ur10": ("ur10-grid", "ur10-joints", "ur10-iso"),
    "kr300": ("kr300", "kr300-b"),
    "panda-1": ("panda-1", "panda-1-sensor"),
    "ur5": ("ur5-grid",),
    "panda-3": ("panda-3",),
}
LONG = 300  # rows from which each half tells as much as a recording


@dataclass(frozen=True)
class Shared:
    """A parameter that both recordings state."""

    name: str  # of its cause and of itself
    one: float  # its value in the first recording [unit]
    other: float  # in the second
    z: float  # their difference over its stated error
    unit: str


@dataclass(frozen=True)
class Gone:
    """A cause that is sure in one recording and ruled out in the other, which could show it."""

    cause: str
    sure_in: str  # the recording that is sure of it
    probability: float  # there
    elsewhere: float  # probability in the other
    tied: bool  # whether the other says that it cannot tell it from what it names


@dataclass(frozen=True)
class Pair:
    """Two recordings of one robot."""

    one: str
    other: str
    shared: tuple[Shared, ...]
    gone: tuple[Gone, ...]
    rms_z: float | None  # root mean square of the shared parameters' z; none without any


@dataclass(frozen=True)
class Found:
    """All that was measured; names of the fields are the keys of the JSON."""

    rows: int
    seed: int
    pairs: tuple[Pair, ...]
    rms_z: float | None  # over the shared parameters of all pairs
    gone: int  # causes that come and go, ties left out
    tied: int  # those that the other recording cannot tell from what it names


@dataclass(frozen=True, eq=False)
class Heard:
    """A recording and what was said of it."""

    name: str
    recording: Recording
    verdict: Verdict


def compared(one: Heard, other: Heard) -> Pair:
    """What two recordings of one robot agree on."""
    shared = tuple(_shared(one.verdict, other.verdict))
    gone = (*_gone(one, other), *_gone(other, one))
    return Pair(one.name, other.name, shared, gone, rms([s.z for s in shared]))


def rms(values: list[float]) -> float | None:
    """Root mean square; none of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values else None


def _shared(one: Verdict, other: Verdict) -> Iterator[Shared]:
    theirs = {(*key_of(c), c.get("variant", "")): c for c in other["causes"]}
    for cause in one["causes"]:
        same = theirs.get((*key_of(cause), cause.get("variant", "")))
        for name, mine in cause["parameters"].items():
            its = (same or {}).get("parameters", {}).get(name)
            error = 0.0 if its is None else float(np.hypot(_std(mine), _std(its)))
            if its is not None and error > 0.0:
                a, b = float(mine["value"]), float(its["value"])
                yield Shared(f"{label(key_of(cause))} {name}", a, b, (a - b) / error, mine["unit"])


def _std(parameter: dict[str, Any]) -> float:
    return float(parameter.get("std") or 0.0)


def label(key: Key) -> str:
    """An effect with its element's number."""
    return key[0] if key[1] is None else f"{key[0]} {key[1]}"


def _gone(here: Heard, there: Heard) -> Iterator[Gone]:
    """Causes that are sure here and ruled out there."""
    for cause in here.verdict["causes"]:
        key, probability = key_of(cause), float(cause["probability"])
        elsewhere = probability_of(there.verdict, key)
        if probability > SURE and elsewhere < RULED_OUT and can_show(there, key):
            tied = _is_tied(there.verdict, key)
            yield Gone(label(key), here.name, probability, elsewhere, tied)


def can_show(heard: Heard, key: Key) -> bool:
    """Whether a recording has the columns for an effect, and says that it can see it."""
    if key in {key_of(blind) for blind in heard.verdict.get("unobservable", ())}:
        return False
    effect = REGISTRY.get(key[0])
    offered = () if effect is None else effect.candidates(scope_of(heard.recording))
    return any(variant.element == key[1] for variant in offered)


def _is_tied(verdict: Verdict, key: Key) -> bool:
    """Whether a verdict lists a cause among what it cannot tell from one that it names."""
    rivals = (rival for cause in verdict["causes"] for rival in cause.get("confounded_with") or ())
    return key in {key_of(rival) for rival in rivals}


def halves(recording: Recording) -> tuple[Recording, Recording]:
    """The first and the second half of a recording, in its order."""
    rows = np.arange(len(recording))
    return recording.select(rows[: len(rows) // 2]), recording.select(rows[len(rows) // 2 :])


def thinned(recording: Recording, rows: int) -> Recording:
    """At most so many rows, evenly; all of them for 0."""
    if not rows or len(recording) <= rows:
        return recording
    return recording.select(np.linspace(0, len(recording) - 1, rows).round().astype(int))


def pairs_of(
    recordings: dict[str, Recording], ask: Asked, rows: int, words: str = ""
) -> tuple[Pair, ...]:
    """Every two recordings of one robot, and the halves of each long one."""
    heard = {
        name: Heard(name, part, ask(part))
        for name, part in counted(
            [(name, thinned(r, rows)) for name, r in recordings.items()], words
        )
    }
    found = [compared(one, other) for one, other in combinations(heard.values(), 2)]
    for name, recording in recordings.items():
        if len(recording) >= LONG:
            parts = [thinned(part, rows) for part in halves(recording)]
            ends = zip(("first half", "second half"), parts, strict=True)
            found.append(compared(*(Heard(f"{name}, {end}", p, ask(p)) for end, p in ends)))
    return tuple(found)


def summed(pairs: tuple[Pair, ...], rows: int, seed: int) -> Found:
    """All pairs together."""
    gone = [gone for pair in pairs for gone in pair.gone]
    z = [shared.z for pair in pairs for shared in pair.shared]
    tied = sum(g.tied for g in gone)
    return Found(rows, seed, pairs, rms(z), len(gone) - tied, tied)


def read(names: tuple[str, ...]) -> dict[str, Recording]:
    """The public recordings of one robot that this version knows."""
    known = {source.name for source in list_sources()}
    with tempfile.TemporaryDirectory() as folder:
        return {name: load_recording(fetch(name, Path(folder))) for name in names if name in known}


def tables(found: Found) -> list[Table]:
    """One line a pair, then what comes and goes."""
    table = Table("recording", "and", "shared parameters", "RMS z", "come and go", "tied")
    rows = f"at most {found.rows} rows" if found.rows else "all rows"
    table.title = f"The same robot recorded again; {rows}, seed {found.seed}"
    for pair in found.pairs:
        ties = sum(g.tied for g in pair.gone)
        z = "-" if pair.rms_z is None else f"{pair.rms_z:.2f}"
        counts = (str(len(pair.shared)), z, str(len(pair.gone) - ties), str(ties))
        table.add_row(pair.one, pair.other, *counts)
    z = "-" if found.rms_z is None else f"{found.rms_z:.2f}"
    table.caption = f"all: RMS z {z}, {found.gone} causes come and go, {found.tied} are tied"
    lost = Table("cause", "sure in", "there", "in the other", "tied", title="Come and go")
    for pair in found.pairs:
        for gone in pair.gone:
            chances = (f"{gone.probability:.2f}", f"{gone.elsewhere:.2f}")
            lost.add_row(gone.cause, gone.sure_in, *chances, "yes" if gone.tied else "no")
    return [table, lost] if lost.row_count else [table]


def measured(names: tuple[str, ...], ask: Asked, rows: int, seed: int) -> Found:
    """Diagnose the recordings of so many robots.

    Raises:
        PlumblineError: A robot is not known.
    """
    odd = next((name for name in names if name not in ROBOTS), None)
    if odd is not None:
        raise fault("--robot", odd, ", ".join(ROBOTS), f"best matches: {best_matches(odd, ROBOTS)}")
    pairs = [pair for name in names for pair in pairs_of(read(ROBOTS[name]), ask, rows, name)]
    if not pairs:
        raise PlumblineError(f"{', '.join(names)}: no two recordings; name another robot")
    return summed(tuple(pairs), rows, seed)


def bench(
    robot: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="This robot; may be repeated.")
    ] = None,
    rows: Annotated[int, typer.Option(min=0, help="Most rows of a recording; 0 for all.")] = 1500,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the diagnosis.")] = 0,
    json: Json = None,
) -> None:
    """Hold the verdicts on recordings of the same robot against each other."""
    names = tuple(robot or ROBOTS)
    tell(lambda: measured(names, asking(seed), rows, seed), tables, json)


if __name__ == "__main__":
    typer.run(bench)

r"""Does the same robot, recorded again, get the same answer?

``python -m plumbline.experiments.benches.consistency [--robot ur10] [--rows N]``

Recordings of one robot in pairs, and both halves of each long one. For every parameter that both
verdicts of a pair state, of the same effect, element and variant,

.. math:: z = (a - b) / \sqrt{s_a^2 + s_b^2},

whose root mean square is 1 where the stated errors hold from one recording to the next. A cause
*comes and goes* if it has more than .95 in one and less than .05 in the other, although the other
could show it; where the other says that it cannot tell it from what it names, that is said apart.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from plumbline.errors import PlumblineError, best_matches, fault
from plumbline.experiments.benches import asking
from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.sources import list_sources
from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.recording import Recording

ROBOTS = {
    "ur10": ("ur10-grid", "ur10-joints", "ur10-iso"),
    "kr300": ("kr300", "kr300-b"),
    "panda-1": ("panda-1", "panda-1-sensor"),
    "ur5": ("ur5-grid",),
    "panda-3": ("panda-3",),
}
LONG = 300  # rows from which each half tells as much as a recording


@dataclass(frozen=True, eq=False)
class Heard:
    """A recording and what was said of it."""

    name: str
    recording: Recording
    verdict: asking.Verdict


@dataclass(frozen=True)
class Pair:
    """Two recordings of one robot: the parameters that both state, and what comes and goes."""

    one: str
    other: str
    shared: list[dict[str, Any]]  # cause and parameter, both values [unit], z
    gone: list[dict[str, Any]]  # cause, sure in, probabilities there and elsewhere, tied

    @property
    def z(self) -> list[float]:
        """Differences of the shared parameters over their stated errors."""
        return [shared["z"] for shared in self.shared]


def compared(one: Heard, other: Heard) -> Pair:
    """What two recordings of one robot agree on."""
    gone = [*_gone(one, other), *_gone(other, one)]
    return Pair(one.name, other.name, list(_shared(one.verdict, other.verdict)), gone)


def rms(values: list[float]) -> float:
    """Root mean square; nan of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def _shared(one: asking.Verdict, other: asking.Verdict) -> Iterator[dict[str, Any]]:
    theirs = {(*asking.key_of(c), c.get("variant", "")): c for c in other["causes"]}
    for cause in one["causes"]:
        same = theirs.get((*asking.key_of(cause), cause.get("variant", "")))
        for name, mine in cause["parameters"].items():
            its = (same or {}).get("parameters", {}).get(name)
            error = 0.0 if its is None else float(np.hypot(_std(mine), _std(its)))
            if its is not None and error > 0.0:
                a, b = float(mine["value"]), float(its["value"])
                named = f"{asking.label(asking.key_of(cause))} {name} [{mine['unit']}]"
                yield {"parameter": named, "one": a, "other": b, "z": (a - b) / error}


def _std(parameter: dict[str, Any]) -> float:
    return float(parameter.get("std") or 0.0)


def _gone(here: Heard, there: Heard) -> Iterator[dict[str, Any]]:
    """Causes that are sure here and ruled out there, where they could show."""
    for cause in here.verdict["causes"]:
        key, probability = asking.key_of(cause), float(cause["probability"])
        elsewhere = asking.probability_of(there.verdict, key)
        if probability > asking.SURE and elsewhere < asking.RULED_OUT and can_show(there, key):
            tied = _is_tied(there.verdict, key)
            yield {"cause": asking.label(key), "sure in": here.name, "there": probability,
                   "in the other": elsewhere, "tied": tied}  # fmt: skip


def can_show(heard: Heard, key: Key) -> bool:
    """Whether a recording has the columns for an effect, and says that it can see it."""
    if key in {asking.key_of(blind) for blind in heard.verdict.get("unobservable", ())}:
        return False
    effect = REGISTRY.get(key[0])
    offered = () if effect is None else effect.candidates(scope_of(heard.recording))
    return any(variant.element == key[1] for variant in offered)


def _is_tied(verdict: asking.Verdict, key: Key) -> bool:
    """Whether a verdict lists a cause among what it cannot tell from one that it names."""
    rivals = (rival for cause in verdict["causes"] for rival in cause.get("confounded_with") or ())
    return key in {asking.key_of(rival) for rival in rivals}


def halves(recording: Recording) -> tuple[Recording, Recording]:
    """The first and the second half of a recording, in its order."""
    rows = np.arange(len(recording))
    return recording.select(rows[: len(rows) // 2]), recording.select(rows[len(rows) // 2 :])


def pairs_of(
    recordings: dict[str, Recording], ask: asking.Asked, rows: int, words: str = ""
) -> tuple[Pair, ...]:
    """Every two recordings of one robot, and the halves of each long one."""
    heard = {
        name: Heard(name, part, ask(part))
        for name, part in asking.counted(
            [(name, asking.thinned(r, rows)) for name, r in recordings.items()], words
        )
    }
    found = [compared(one, other) for one, other in combinations(heard.values(), 2)]
    for name, recording in recordings.items():
        if len(recording) >= LONG:
            parts = [asking.thinned(part, rows) for part in halves(recording)]
            ends = zip(("first half", "second half"), parts, strict=True)
            found.append(compared(*(Heard(f"{name}, {end}", p, ask(p)) for end, p in ends)))
    return tuple(found)


def tables(pairs: tuple[Pair, ...]) -> Found:
    """One line a pair, then what is shared, what comes and goes, and the figures of all."""
    lines = []
    for pair in pairs:
        tied = sum(gone["tied"] for gone in pair.gone)
        lines.append({
            "recording": pair.one, "and": pair.other, "shared parameters": len(pair.shared),
            "RMS z": rms(pair.z), "come and go": len(pair.gone) - tied, "tied": tied,
        })  # fmt: skip
    return {
        "the same robot recorded again": pd.DataFrame(lines),
        "shared": pd.DataFrame([shared for pair in pairs for shared in pair.shared]),
        "come and go": pd.DataFrame([gone for pair in pairs for gone in pair.gone]),
        "RMS z of all": rms([z for pair in pairs for z in pair.z]),
    }


def read(names: tuple[str, ...]) -> dict[str, Recording]:
    """The public recordings of one robot that this version knows."""
    known = {source.name for source in list_sources()}
    there = [name for name in names if name in known]
    return dict(zip(there, asking.fetched(there), strict=True))


def measured(names: tuple[str, ...], ask: asking.Asked, rows: int) -> Found:
    """Diagnose the recordings of so many robots (PlumblineError: a robot is not known)."""
    odd = next((name for name in names if name not in ROBOTS), None)
    if odd is not None:
        raise fault("--robot", odd, ", ".join(ROBOTS), f"best matches: {best_matches(odd, ROBOTS)}")
    pairs = [pair for name in names for pair in pairs_of(read(ROBOTS[name]), ask, rows, name)]
    if not pairs:
        raise PlumblineError(f"{', '.join(names)}: no two recordings; name another robot")
    return tables(tuple(pairs))


@as_command
def bench(
    robot: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="This robot; may be repeated.")
    ] = None,
    rows: Annotated[int, typer.Option(min=0, help="Most rows of a recording; 0 for all.")] = 1500,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the diagnosis.")] = 0,
) -> Found:
    """Hold the verdicts on recordings of the same robot against each other."""
    return measured(tuple(robot or ROBOTS), asking.asking(seed), rows)


if __name__ == "__main__":
    typer.run(bench)

"""Are ranges and fiducials diagnosed rightly, on cases whose simulator shares no code with it?

``python -m plumbline.experiments.benches.parts [--kind ranges] [--sort single] [--count 40]``

Of each kind as many cases with one thing wrong, left at 1 to 4 sigma, with nothing wrong, and with
what the library lacks; every case is drawn by its seed, and the truth is held apart from the folder
that is diagnosed. Ranges are of 300 rows on three boards by an arm of seven joints, by its poses in
every other case whose flaw is not the arm's; fiducials of eight markers touched five times each, or
of ten touched once.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from plumbline.errors import best_matches, fault
from plumbline.experiments.benches import tell
from plumbline.experiments.benches.asking import SURE, Asked, asking, counted, key_of, surest
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.reality.arms import arm
from plumbline.experiments.reality.parts import head, room_flaws
from plumbline.experiments.reality.parts.drawing import (
    RangePlan,
    Truth,
    draw_fiducials,
    draw_ranges,
)
from plumbline.optim.loading import load_to_diagnose

SORTS = ("single", "clean", "outside")
LEAST, MOST = 1.0, 4.0  # gaps [noise]
FLAGGED = 0.5  # probability of something outside the library at which it is flagged
ONCE = ("marker_shift", "ct_scale")  # that markers touched once can show, of no known pitch
ANEW = 50  # seeds that are tried for a room in which the arm reaches all boards


@dataclass(frozen=True)
class Case:
    """One case: what was wrong, what was said first, how sure, and how long it took [s]."""

    truth: str
    element: int | None
    gap: float
    seed: int
    verdict: str
    first: str
    first_element: int | None
    sure: float
    outside: float
    seconds: float

    @property
    def right(self) -> bool:
        """Whether effect and element were named first."""
        return (self.truth, self.element) == (self.first, self.first_element)


@dataclass(frozen=True)
class Bench:
    """What was found: every case of each kind and sort."""

    cases: dict[str, dict[str, list[Case]]]


Draw = Callable[[Path, str | None, float, int, int], Truth]


def _ranges(folder: Path, name: str | None, gap: float, seed: int, number: int) -> Truth:
    """A case of ranges; poses in place of joints in every other one."""
    plan = RangePlan(poses=name not in room_flaws.OF_ARM and number // 2 % 2 == 1)
    for more in range(ANEW):
        try:
            return draw_ranges(folder, arm("lbr"), name, gap, seed + 1000 * more, plan)
        except ValueError:
            continue  # this room is out of the arm's reach
    raise fault("--seed", str(seed), "a room in reach", "choose another")


def _fiducials(folder: Path, name: str | None, gap: float, seed: int, number: int) -> Truth:
    """A case of fiducials; every fourth round of markers that are touched once."""
    once = name in (None, *ONCE) and number % 4 == 3
    return draw_fiducials(folder, name, gap, seed, *((10, 1) if once else (8, 5)))


KINDS: dict[str, tuple[Draw, Sequence[str], Sequence[str]]] = {
    "ranges": (_ranges, (*room_flaws.OF_ROOM, *room_flaws.OF_ARM), room_flaws.BEYOND),
    "fiducials": (_fiducials, head.OF_HEAD, head.BEYOND),
}


def cases_of(kind: str, sort: str, count: int, seed: int, asked: Asked) -> list[Case]:
    """Draw and diagnose the cases of a kind: ``single``, ``clean`` or ``outside``."""
    draw, inside, beyond = KINDS[kind]
    names: Sequence[str | None] = {"single": inside, "clean": (None,), "outside": beyond}[sort]
    found = []
    for k in counted(range(count), f"{kind}, {sort}:"):
        rng = np.random.default_rng([seed, k, len(names)])
        gap = float(rng.uniform(LEAST, MOST))
        own = int(rng.integers(2**31))
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "case"
            truth = draw(folder, names[k % len(names)], gap, own, k // len(names))
            begun = perf_counter()
            said = asked(load_to_diagnose(folder))
            seconds = perf_counter() - begun
        first = key_of(said["causes"][0]) if said["causes"] else ("", None)
        told = (truth.name or "", truth.element, truth.gap, own, str(said["verdict"]), *first)
        outside = float(said["outside_probability"])
        found.append(Case(*told, surest(said), outside, seconds))
    return found


def tables(found: Bench) -> list[Table]:
    """Figures by kind, and what was named first where that was wrong."""
    table = Table("kind", "cases", "figure", title="Ranges and fiducials")
    wrong = Table("kind", "was", "said first", "cases", title="Wrong ones")
    for kind, by_sort in found.cases.items():
        single, clean, outside = (by_sort.get(sort, []) for sort in SORTS)
        right = sum(case.right for case in single)
        sure = [case for case in single if case.sure > SURE]
        table.add_row(kind, f"{len(single)} single", f"{right} named first")
        table.add_row(kind, f"{len(sure)} sure", f"{sum(case.right for case in sure)} right")
        alarms = sum(case.verdict != "no-gap" for case in clean)
        table.add_row(kind, f"{len(clean)} clean", f"{alarms} false alarms")
        flagged = sum(case.outside > FLAGGED for case in outside)
        table.add_row(kind, f"{len(outside)} outside", f"{flagged} flagged")
        seconds = [case.seconds for case in (*single, *clean, *outside)]
        table.add_row(kind, "all", f"{np.median(seconds):.1f} s, at most {max(seconds):.1f} s")
        missed = [case for case in single if not case.right]
        missed += [case for case in clean if case.verdict != "no-gap"]
        missed += [case for case in outside if case.outside <= FLAGGED]
        told = Counter(
            (_named(c.truth or "nothing", c.element), _named(c.first or c.verdict, c.first_element))
            for c in missed
        )
        for (was, said), count in told.most_common():
            wrong.add_row(kind, was, said, str(count))
    return [table, wrong]


def _named(name: str, element: int | None) -> str:
    return name if element is None else f"{name} {element}"


def _chosen(option: str, asked: str, every: str, known: Iterable[str]) -> list[str]:
    """One of the known, or all of them.

    Raises:
        PlumblineError: It is none of them.
    """
    if asked not in (every, *known):
        near = best_matches(asked, known)
        listed = ", ".join((every, *known))
        raise fault(option, repr(asked), listed, f"best matches: {near}")
    return list(known) if asked == every else [asked]


def main(
    kind: Annotated[str, typer.Option(help="ranges, fiducials, or both.")] = "both",
    count: Annotated[int, typer.Option(min=1, help="Cases of each sort.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="Of all cases.")] = 0,
    sort: Annotated[str, typer.Option(help="single, clean, outside, or all.")] = "all",
    json: Json = None,
) -> None:
    """Diagnose simulated ranges and fiducials, and count what is right."""

    def measure() -> Bench:
        kinds, sorts = _chosen("--kind", kind, "both", KINDS), _chosen("--sort", sort, "all", SORTS)
        asked = asking(0)
        return Bench({k: {s: cases_of(k, s, count, seed, asked) for s in sorts} for k in kinds})

    tell(measure, tables, json)


if __name__ == "__main__":
    typer.run(main)

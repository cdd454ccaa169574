"""Are ranges and fiducials diagnosed rightly, on cases whose simulator shares no code with it?

``python -m plumbline.experiments.benches.parts [--kind ranges] [--sort single] [--count 40]``

Of each kind as many cases with one thing wrong, left at 1 to 4 sigma, with nothing wrong, and with
what the library lacks; every case is drawn by its seed, and the truth is held apart from the folder
that is diagnosed. Ranges are of 300 rows on three boards by an arm of seven joints, by its poses in
every other case whose flaw is not the arm's; fiducials of eight markers touched five times each, or
of ten touched once.
"""

import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from plumbline.errors import best_matches, fault
from plumbline.experiments.benches.asking import SURE, Asked, asking, counted, key_of, label, surest
from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.reality.arms import arm
from plumbline.experiments.reality.parts import drawing, room
from plumbline.experiments.sweep.simulated import FLAGGED
from plumbline.optim.loading import load_to_diagnose

SORTS = ("single", "clean", "outside")
LEAST, MOST = 1.0, 4.0  # gaps [noise]
ONCE = ("marker_shift", "ct_scale")  # that markers touched once can show, of no known pitch
ANEW = 50  # seeds that are tried for a room in which the arm reaches all boards


Draw = Callable[[Path, str | None, float, int, int], drawing.Truth]


def _ranges(folder: Path, name: str | None, gap: float, seed: int, number: int) -> drawing.Truth:
    """A case of ranges; poses in place of joints in every other one."""
    plan = drawing.RangePlan(poses=name not in room.OF_ARM and number // 2 % 2 == 1)
    seeds = range(seed, seed + 1000 * ANEW, 1000)
    return drawing.draw_reached(folder, arm("lbr"), name, gap, seeds, plan)


def _fiducials(folder: Path, name: str | None, gap: float, seed: int, number: int) -> drawing.Truth:
    """A case of fiducials; every fourth round of markers that are touched once."""
    once = name in (None, *ONCE) and number % 4 == 3
    return drawing.draw_fiducials(folder, name, gap, seed, *((10, 1) if once else (8, 5)))


KINDS: dict[str, tuple[Draw, Sequence[str], Sequence[str]]] = {
    "ranges": (_ranges, (*room.OF_ROOM, *room.OF_ARM), room.BEYOND),
    "fiducials": (_fiducials, drawing.OF_HEAD, drawing.BEYOND),
}


def cases_of(kind: str, sort: str, count: int, seed: int, asked: Asked) -> pd.DataFrame:
    """Draw and diagnose the cases of a kind: ``single``, ``clean`` or ``outside``; one a row."""
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
        true = label((truth.name, truth.element)) if truth.name else "nothing"
        named = [label(key_of(cause)) for cause in said["causes"]]
        flagged = float(said["outside_probability"]) > FLAGGED
        right = {"single": named[:1] == [true], "clean": said["verdict"] == "no-gap",
                 "outside": flagged}[sort]  # fmt: skip
        found.append({
            "kind": kind, "sort": sort, "truth": true, "gap": truth.gap, "seed": own,
            "verdict": str(said["verdict"]), "first": named[0] if named else str(said["verdict"]),
            "sure": surest(said) > SURE, "flagged": flagged, "right": right, "seconds": seconds,
        })  # fmt: skip
    return pd.DataFrame(found)


def tables(cases: pd.DataFrame) -> Found:
    """How many are right, also of those that were sure, and what was taken for what."""
    groups = cases.groupby(["kind", "sort"], sort=False)
    counts = groups.agg(
        cases=("right", "size"), right=("right", "sum"), sure=("sure", "sum"),
        seconds=("seconds", "median"), slowest=("seconds", "max"),
    )  # fmt: skip
    counts.insert(3, "sure and right", (cases["sure"] & cases["right"]).groupby(
        [cases["kind"], cases["sort"]], sort=False).sum())  # fmt: skip
    wrong = cases[~cases["right"]].groupby(["kind", "truth", "first"]).size()
    return {
        "right: named first, no gap, or flagged": counts.reset_index(),
        "wrong ones": wrong.reset_index(name="cases"),
        "cases": cases,
    }


def _chosen(option: str, asked: str, every: str, known: Iterable[str]) -> list[str]:
    if asked not in (every, *known):
        near = best_matches(asked, known)
        listed = ", ".join((every, *known))
        raise fault(option, repr(asked), listed, f"best matches: {near}")
    return list(known) if asked == every else [asked]


@as_command
def bench(
    kind: Annotated[str, typer.Option(help="ranges, fiducials, or both.")] = "both",
    count: Annotated[int, typer.Option(min=1, help="Cases of each sort.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="Of all cases.")] = 0,
    sort: Annotated[str, typer.Option(help="single, clean, outside, or all.")] = "all",
) -> Found:
    """Diagnose simulated ranges and fiducials, and count what is right."""
    kinds, sorts = _chosen("--kind", kind, "both", KINDS), _chosen("--sort", sort, "all", SORTS)
    asked = asking(0)
    return tables(pd.concat([cases_of(k, s, count, seed, asked) for k in kinds for s in sorts]))


if __name__ == "__main__":
    typer.run(bench)

"""Time and memory of a diagnosis: ``python -m plumbline.experiments.benches.central``.

Of recordings that the simulators write, of ever more rows, each in a process of its own: time from
the arrays to the verdict (median of several runs, and the first, with nothing compiled), and the
most memory that the process held. The target is a ratio, since machines differ.
"""

import multiprocessing
import resource
import statistics
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Annotated

import pandas as pd
import typer

from plumbline.experiments.benches.asking import loaded
from plumbline.experiments.console.measured import Found, as_command, timed
from plumbline.experiments.reality import Plan, draw_case, simulate
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.recording.recording import Recording

ARM, SEED = "ur10", 5
RUNS = {100: 5, 1_000: 3, 10_000: 1, 100_000: 1}  # runs by number of rows


@dataclass(frozen=True)
class Cost:
    """What a diagnosis of some rows takes, in a process of its own."""

    rows: int  # number of rows
    seconds: float  # median time from arrays to verdict [s]
    first: float  # time of the first run [s]
    peak: float  # most memory that the process ever held [MB]
    verdict: str  # what it found
    ratio: float | None = None  # time over that of a tenth of the rows; None for the fewest


def recorded(rows: int, effect: str) -> Recording:
    """A simulated recording of one arm with one effect three times as large as the noise."""
    plan = Plan(
        rows=(rows, rows), gap=(3.0, 3.0), surgical=0.0, moving=0.0, effects=(effect,), arms=(ARM,)
    )
    return loaded(simulate(draw_case(plan, f"{ARM}-{effect}-{rows}", SEED))[0])


def cost_of(rows: int) -> Cost:
    """Time and memory of a diagnosis; the memory is the process's own, so give it a fresh one."""
    recording = recorded(rows, "transmission_ripple")
    diagnosis, seconds = timed(lambda: diagnose(recording), RUNS[rows])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    unit = 1e6 if sys.platform == "darwin" else 1e3  # bytes there, kilobytes elsewhere
    verdict = diagnosis.verdict
    named = ": ".join([verdict.verdict.value, *(cause.label for cause in verdict.causes)])
    return Cost(rows, statistics.median(seconds), seconds[0], peak / unit, named)


def costs(counts: Sequence[int]) -> tuple[Cost, ...]:
    """The cost of every number of rows, each in a process of its own."""
    found: list[Cost] = []
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=fresh, max_tasks_per_child=1) as pool:
        for rows in counts:
            now = pool.submit(cost_of, rows).result()
            ratio = now.seconds / found[-1].seconds if found else None
            found.append(replace(now, ratio=ratio))
    return tuple(found)


@as_command
def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Leave out what takes minutes.")] = False,
) -> Found:
    """Measure time and memory of a whole diagnosis.

    Hoped for: ten times as long for ten times the rows at most, 100 rows in 2 s.
    """
    counts = [n for n in RUNS if not quick or n <= 10_000]
    return {"diagnosis": pd.DataFrame(costs(counts))}


if __name__ == "__main__":
    typer.run(bench)

"""Time and memory of the central computations: ``python -m plumbline.experiments.benches.central``.

Three questions, each on recordings that the simulators write: how the cost of a diagnosis grows
with its rows, how a scan of every single effect compares with fitting them one by one, and how long
a small recording takes from its arrays to the verdict. Times are medians of several runs. Two of
the three targets are ratios within one run, since machines differ.
"""

from __future__ import annotations

import multiprocessing
import resource
import statistics
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from plumbline.experiments.benches import tell, timed
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.reality import Plan, draw_case, simulate, write
from plumbline.kinematics.effects import EFFECTS, Effect
from plumbline.optim.diagnosis.baselines import Single, one_by_one
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.posterior.evidence import Candidate, NoisePrior
from plumbline.optim.diagnosis.posterior.pool import make_pool
from plumbline.optim.diagnosis.posterior.search import SOLVER, fit
from plumbline.optim.diagnosis.predict.folds import fold_of_rows
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording

ARM, SEED, SMALL = "ur10", 5, 100
RUNS = {100: 5, 1_000: 3, 10_000: 1, 100_000: 1}  # runs by number of rows
QUICK_STRIDE = 20  # of a dense family, every so manieth variant is fitted when in a hurry
MOST_A_DECADE, LEAST_FASTER, MOST_SECONDS = 10.0, 50.0, 2.0


@dataclass(frozen=True)
class Cost:
    """What a diagnosis of some rows takes, in a process of its own."""

    rows: int  # number of rows
    seconds: float  # median time from arrays to verdict [s]
    peak: float  # most memory that the process ever held [MB]
    verdict: str  # what it found
    ratio: float | None = None  # time over that of a tenth of the rows; None for the fewest


@dataclass(frozen=True)
class Race:
    """A scan of all single effects beside fits of the same, one by one."""

    rows: int  # number of rows
    candidates: int  # variants in the race
    fitted: int  # how many of them were fitted; the time of the others is extrapolated
    scan: float  # median time of the scan, from arrays to the odds of every candidate [s]
    fits: float  # time inside of the fits alone, the statement of their residuals left out [s]
    ratio: float  # how many times faster the scan is
    scan_best: str  # what the scan finds most probable
    fits_best: str  # what has the lowest BIC of the fits


@dataclass(frozen=True)
class Whole:
    """A small recording from its arrays to the verdict."""

    rows: int  # number of rows
    seconds: float  # median time [s]
    first: float  # time of the first run, with nothing compiled yet [s]
    runs: int  # how many runs


@dataclass(frozen=True)
class Bench:
    """All that was measured; names of the fields are the keys of the JSON."""

    cost: tuple[Cost, ...]
    race: Race
    whole: Whole


def recorded(folder: Path, rows: int, effect: str) -> Recording:
    """A simulated recording of one arm with one effect three times as large as the noise."""
    plan = Plan(
        rows=(rows, rows), gap=(3.0, 3.0), surgical=0.0, moving=0.0, effects=(effect,), arms=(ARM,)
    )
    target = folder / f"{ARM}-{effect}-{rows}"
    write(target, simulate(draw_case(plan, target.name, SEED))[0])
    return load_recording(target)


def cost_of(folder: Path, rows: int) -> Cost:
    """Time and memory of a diagnosis; the memory is the process's own, so give it a fresh one."""
    recording = recorded(folder, rows, "transmission_ripple")
    diagnosis, seconds = timed(lambda: diagnose(recording), RUNS[rows])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    unit = 1e6 if sys.platform == "darwin" else 1e3  # bytes there, kilobytes elsewhere
    return Cost(rows, statistics.median(seconds), peak / unit, _named(diagnosis.verdict))


def costs(folder: Path, counts: Sequence[int]) -> tuple[Cost, ...]:
    """The cost of every number of rows, each in a process of its own."""
    found: list[Cost] = []
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=fresh, max_tasks_per_child=1) as pool:
        for rows in counts:
            now = pool.submit(cost_of, folder, rows).result()
            ratio = now.seconds / found[-1].seconds if found else None
            found.append(Cost(now.rows, now.seconds, now.peak, now.verdict, ratio))
    return tuple(found)


def scanned(recording: Recording) -> Candidate:
    """The most probable single effect, by a nominal fit, one linearisation and one scan."""
    folds = fold_of_rows(recording, "auto", 0)
    weights = np.ones(len(recording))
    model, nominal = fit(recording, (), nuisances_of(recording), weights, SOLVER)
    noise = NoisePrior.of(recording.noise_std)
    selection = make_pool(model, nominal.x, folds, noise).selection
    log_odds, _ = selection.scan(selection.reduce([]))
    return selection.candidates[int(np.argmax(log_odds))]


def singles(recording: Recording) -> list[Effect]:
    """Every variant of every effect that the scan looks at."""
    scope = scope_of(recording)
    kinds = [kind for kind in EFFECTS if kind.name != "tool_offset"]  # the tool is always fitted
    return [variant for kind in kinds for variant in kind.candidates(scope)]


def race_of(recording: Recording, stride: int, runs: int = 5) -> Race:
    """Scan all single effects, and fit them one by one; of dense families every ``stride``-th."""
    best, seconds = timed(lambda: scanned(recording), runs)
    effects = singles(recording)
    plain = [e for e in effects if e.scanned is None]
    dense = [e for e in effects if e.scanned is not None]
    fits = one_by_one(recording, plain), one_by_one(recording, dense[::stride])
    together = _time(fits[0]) + _time(fits[1]) * len(dense) / max(len(fits[1]), 1)
    scan = statistics.median(seconds)
    return Race(
        rows=len(recording),
        candidates=len(effects),
        fitted=len(fits[0]) + len(fits[1]),
        scan=scan,
        fits=together,
        ratio=together / scan,
        scan_best=best.effect.label,
        fits_best=min([*fits[0], *fits[1]], key=lambda single: single.bic).effect.label,
    )


def whole_of(recording: Recording, runs: int = 5) -> Whole:
    """Time of a whole diagnosis."""
    _, seconds = timed(lambda: diagnose(recording), runs)
    return Whole(len(recording), statistics.median(seconds), seconds[0], runs)


def measured(*, quick: bool) -> Bench:
    """Measure everything; when quick, without the largest recording and with a part of the fits."""
    with tempfile.TemporaryDirectory(prefix="plumbline-bench-") as scratch:
        folder = Path(scratch)
        whole = whole_of(recorded(folder, SMALL, "transmission_ripple"))
        race = race_of(recorded(folder, SMALL, "joint_compliance"), QUICK_STRIDE if quick else 1)
        return Bench(costs(folder, [n for n in RUNS if not quick or n <= 10_000]), race, whole)


def tables(bench: Bench) -> list[Table]:
    """What was measured, with the targets."""
    rows = Table("rows", "time", "per decade", "peak memory", "verdict", title="A whole diagnosis")
    for cost in bench.cost:
        ratio = "" if cost.ratio is None else f"x {cost.ratio:.1f}"
        peak, time = f"{cost.peak:,.0f} MB", f"{cost.seconds:.2f} s"
        rows.add_row(f"{cost.rows:,}", time, ratio, peak, cost.verdict)
    steepest = max((cost.ratio or 0.0 for cost in bench.cost), default=0.0)
    rows.caption = _against(f"steepest decade x {steepest:.1f}", "at most x", MOST_A_DECADE, "")
    race, whole = bench.race, bench.whole
    single = Table("how", "time", "best", title=f"{race.candidates:,} single effects alone")
    single.add_row("scan", f"{race.scan:.2f} s", race.scan_best)
    share = "" if race.fitted == race.candidates else f" (from {race.fitted:,} of them)"
    single.add_row("fitted one by one" + share, f"{race.fits:.1f} s", race.fits_best)
    single.caption = _against(f"{race.ratio:.0f} times faster", "at least", LEAST_FASTER, "")
    small = Table("rows", "median", "first run", title="A small recording", min_width=50)
    small.add_row(f"{whole.rows}", f"{whole.seconds:.2f} s", f"{whole.first:.2f} s")
    small.caption = _against(f"median of {whole.runs} runs", "at most", MOST_SECONDS, " s")
    return [rows, single, small]


def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Leave out what takes minutes.")] = False,
    json: Json = None,
) -> None:
    """Measure time and memory, and print them beside what is hoped for."""
    tell(lambda: measured(quick=quick), tables, json)


def _named(verdict: Verdict) -> str:
    causes = ", ".join(cause.label for cause in verdict.causes)
    return f"{verdict.verdict.value}: {causes}" if causes else verdict.verdict.value


def _time(fits: Sequence[Single]) -> float:
    return sum(single.seconds for single in fits)


def _against(found: str, bound: str, target: float, unit: str) -> str:
    return f"{found}; hoped for: {bound} {target:g}{unit}"


if __name__ == "__main__":
    typer.run(bench)

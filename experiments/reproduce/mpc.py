r"""Several instruments that keep clear of each other: the patent's controller, in closed loop.

The patent gives no figure. What it claims is checked: collisions are foreseen, in real time, with
any number of obstacles. Random tasks of seven families are run on a plant that differs from the
model by stated noise, lag, delay, gain error and dead band; coal measures every clearance at every
substep. ``python -m experiments.campaign`` runs ten thousand of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.campaign import HORIZON, V_MAX, task
from experiments.closed_loop import Run
from experiments.passes import SAFE, Passes, passes
from experiments.reality.theatre import FAMILIES, STATED
from experiments.reproduce import Reproduction, Table, figure
from optim.capsule_mpc import OneStep, RealTime
from optim.progress import Progress

EACH = 8  # tasks of a family
PASSES = 12

TITLE = "Capsule MPC for several instruments"
SOURCE = "Patent abstract, 'multi-arm obstacle avoidance by model prediction' (formulas rebuilt)"


def run(seed: int = 0, progress: Progress | None = None) -> Reproduction:
    """Run the tasks, the same without foresight, and the parallel passes."""
    count = EACH * len(FAMILIES)
    runs = []
    for number in range(count):
        _tell(progress, f"task {number + 1} of {count}", 0.8 * number / count)
        runs.append(task(number, seed))
    blind = []
    for number in range(0, count, 2):
        _tell(progress, "without foresight", 0.8 + 0.1 * number / count)
        blind.append(task(number, seed, OneStep(compiled=False), guided=False, most=300))
    _tell(progress, "parallel passes", 0.9)
    planes = passes("planes", RealTime(compiled=False), PASSES, seed)
    scalar = passes("scalar", RealTime(compiled=False), PASSES, seed)
    tables = (_families(runs), _foresight(runs[::2], blind), _passes(planes, scalar))
    return Reproduction(TITLE, SOURCE, _figures(runs, blind, planes, scalar), tables, _notes())


def _tell(progress: Progress | None, words: str, share: float) -> None:
    if progress is not None:
        progress(words, share)


def _times(runs: list[Run]) -> dict[str, float]:
    p50, p99, most = 1e3 * np.percentile(np.concatenate([r.seconds for r in runs]), [50, 99, 100])
    return {"p50": float(p50), "p99": float(p99), "max": float(most)}


def _figures(runs: list[Run], blind: list[Run], planes: Passes, scalar: Passes) -> dict[str, Any]:
    least = min(r.clearance for r in runs)
    share = float(np.mean([r.reached for r in runs]))
    baseline = float(np.mean([r.reached for r in blind]))
    return {
        "scenarios": len(runs),
        "collisions": sum(r.clearance < 0.0 for r in runs),
        "min_clearance": figure(least, "mm", asked=SAFE),
        "step_ms": {**_times(runs), "unit": "ms", "horizon": HORIZON},
        "goals_reached": figure(share, "1", one_step=baseline),
        "parallel_clearance": figure(planes.at_steps, "mm", scalar=scalar.at_steps),
    }


def _row(name: str, runs: list[Run]) -> tuple[str, ...]:
    least, times = min(r.clearance for r in runs), _times(runs)
    return (
        name,
        f"{len(runs)}",
        f"{sum(r.clearance < 0.0 for r in runs)}",
        f"{least:.2f} mm",
        f"{100 * np.mean([r.reached for r in runs]):.0f} %",
        f"{times['p50']:.2f} ms",
        f"{times['p99']:.2f} ms",
    )


def _families(runs: list[Run]) -> Table:
    heads = ("family", "tasks", "collisions", "least clearance", "reached", "median", "p99")
    names = [name for name in FAMILIES if any(r.family == name for r in runs)]
    rows = [_row(name, [r for r in runs if r.family == name]) for name in names]
    return Table("Random tasks, clearances by coal", heads, (*rows, _row("all", runs)))


def _foresight(runs: list[Run], blind: list[Run]) -> Table:
    def row(name: str, own: list[Run]) -> tuple[str, ...]:
        lost = sorted({r.family for r in own if not r.reached})
        rough = float(np.mean([r.acceleration for r in own]))
        least = min(r.clearance for r in own)
        share = 100 * np.mean([r.reached for r in own])
        return name, f"{share:.0f} %", f"{least:.2f} mm", f"{rough:.0f}", ", ".join(lost) or "none"

    heads = ("controller", "reached", "least clearance", "rms acceleration [mm/s²]", "fails in")
    rows = (row("horizon and waypoints", runs), row("one step (barrier functions)", blind))
    return Table("The same tasks with and without foresight", heads, rows)


def _passes(planes: Passes, scalar: Passes) -> Table:
    def row(name: str, own: Passes) -> tuple[str, ...]:
        clear = (f"{own.at_steps:.3f} mm", f"{own.between:.2f} mm")
        return name, *clear, f"{100 * own.short:.1f} %", f"{100 * own.arrived:.0f} %"

    heads = ("distance", "clearance at steps", "between steps", "steps short", "arrived")
    rows = (row("planes", planes), row("the patent's scalar", scalar))
    return Table(f"{PASSES} parallel passes, d_s = {SAFE:g} mm, model exact", heads, rows)


def _notes() -> tuple[str, ...]:
    m = STATED
    return (
        f"The plant: {m.measured:g} mm (1 sigma) of measurement noise per axis, {m.shake:g} mm a "
        f"step, gain off by up to {100 * m.gain:g} %, lag {1e3 * m.lag:g} ms, delay "
        f"{1e3 * m.delay:g} ms, dead band {m.deadband:g} mm/s; v_max {V_MAX:g} mm/s, 20 ms a step.",
        "The patent's formulas are lost and rebuilt; it gives no figure to compare with.",
        "Distances hold at the steps; between two of them a chord may dip, here by what the third "
        "table shows at full speed.",
    )

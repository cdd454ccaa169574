r"""Several instruments that keep clear of each other: the patent's controller, in closed loop.

The patent gives no figure. What it claims is checked: collisions are foreseen, in real time, with
any number of obstacles. Random tasks of all families are run on a plant that differs from the model
by stated noise, lag, delay, gain error and dead band, and judged at every millisecond; then, on
tasks in which foresight should win, the horizon and one step on control barrier functions, with
the same guide and without it. ``plumbline sweep`` runs ten thousand tasks, and
``python -m plumbline.experiments.mpc.foresight`` more of the comparison.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from plumbline.experiments.mpc import foresight
from plumbline.experiments.mpc.campaign import HORIZON, V_MAX, task
from plumbline.experiments.mpc.closed_loop import Run
from plumbline.experiments.mpc.passes import SAFE, Passes, passes
from plumbline.experiments.reality.mpc_scenarios import FAMILIES, STATED
from plumbline.experiments.reproduce import Compared, Reproduction, Table, figure
from plumbline.optim.capsule_mpc import RealTime
from plumbline.optim.core.progress import Progress, silent

EACH = 6  # tasks of a family
FORESEEN = 4  # tasks of a family in the comparison
COMPARED = tuple(foresight.FORESIGHT)
PASSES = 12  # of each form of the distance


def run(seed: int = 0, progress: Progress | None = None) -> Reproduction:
    """Run the tasks, the comparison with one step, and the parallel passes."""
    tell = progress or silent
    count = EACH * len(FAMILIES)
    runs = []
    for number in range(count):
        tell(f"task {number + 1} of {count}", 0.5 * number / count)
        runs.append(task(number, seed))
    both = []
    for k, family in enumerate(COMPARED):
        tell(f"foresight: {family}", 0.5 + 0.4 * k / len(COMPARED))
        both += foresight.compared(FORESEEN, seed, compiled=False, families=(family,))
    tell("parallel passes", 0.9)
    planes = passes("planes", RealTime(compiled=False), PASSES, seed)
    scalar = passes("scalar", RealTime(compiled=False), PASSES, seed)
    compared = Table.of("mpc.foresight", foresight.cells(both), foresight.HEADS)
    tables = (_families(runs), compared, _passes(planes, scalar))
    figures = _figures(runs, both, planes, scalar)
    least = {name: min(r.clearance for r in own) for name, own in _by_family(runs).items()}
    near = tuple((name, figure(gap, "mm", asked=SAFE)) for name, gap in least.items())
    shown = Compared("How near instruments came, by family", near)
    m, wins = STATED, 100 * foresight.WINS
    found = Reproduction.of(
        "mpc", figures, tables, measured=m.measured, shake=m.shake, gain=100 * m.gain,
        lag=1e3 * m.lag, delay=1e3 * m.delay, deadband=m.deadband, fastest=V_MAX, wins=wins,
    )  # fmt: skip
    return replace(found, said=_said(figures), compared=(shown,))


def _said(figures: dict[str, Any]) -> str:
    least, times = figures["min_clearance"]["value"], figures["step_ms"]
    return (
        f"In {figures['scenarios']} random tasks instruments touched {figures['collisions']} times "
        f"and came no nearer than {least:.2f} mm; {100 * figures['goals_reached']['value']:.0f} % "
        f"of the goals were reached, and 99 of 100 steps took less than {times['p99']:.2f} ms."
    )


def _times(runs: list[Run]) -> dict[str, float]:
    p50, p99, most = 1e3 * np.percentile(np.concatenate([r.seconds for r in runs]), [50, 99, 100])
    return {"p50": float(p50), "p99": float(p99), "max": float(most)}


def _figures(
    runs: list[Run], both: list[foresight.Tried], planes: Passes, scalar: Passes
) -> dict[str, Any]:
    least = min(r.clearance for r in runs)
    share = float(np.mean([r.reached for r in runs]))
    return {
        "scenarios": len(runs),
        "collisions": sum(r.clearance < 0.0 for r in runs),
        "min_clearance": figure(least, "mm", asked=SAFE),
        "step_ms": {**_times(runs), "unit": "ms", "horizon": HORIZON},
        "goals_reached": figure(share, "1"),
        "foresight": foresight.figures(both),
        "parallel_clearance": figure(planes.at_steps, "mm", scalar=scalar.at_steps),
    }


def _row(name: str, runs: list[Run]) -> tuple[str, ...]:
    least, times = min(r.clearance for r in runs), _times(runs)
    counts = (f"{len(runs)}", f"{sum(r.clearance < 0.0 for r in runs)}", f"{least:.2f} mm")
    reached = f"{100 * np.mean([r.reached for r in runs]):.0f} %"
    return name, *counts, reached, f"{times['p50']:.2f} ms", f"{times['p99']:.2f} ms"


def _by_family(runs: list[Run]) -> dict[str, list[Run]]:
    found = {name: [r for r in runs if r.family == name] for name in FAMILIES}
    return {name: own for name, own in found.items() if own}


def _families(runs: list[Run]) -> Table:
    rows = [_row(name, own) for name, own in _by_family(runs).items()]
    return Table.of("mpc.families", [*rows, _row("all", runs)])


def _passes(planes: Passes, scalar: Passes) -> Table:
    def row(name: str, own: Passes) -> tuple[str, ...]:
        clear = (f"{own.at_steps:.3f} mm", f"{own.between:.2f} mm")
        return name, *clear, f"{100 * own.short:.1f} %", f"{100 * own.arrived:.0f} %"

    rows = (row("planes", planes), row("the patent's scalar", scalar))
    return Table.of("mpc.passes", rows, passes=PASSES, safe=SAFE)

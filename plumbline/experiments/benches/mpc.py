"""Time and quality of the capsule controller: ``python -m plumbline.experiments.benches.mpc``.

Two instruments swing through each other's place and back, so that their shafts cross twice, among
obstacles of which one moves; 300 steps of 20 ms on the exact model. The same course is driven by
every solver. Times are given twice: by the clock, and of the thread alone, which a busy machine
disturbs less. Clearances are coal's, at the steps. A second part lets horizon, obstacles and
instruments grow; a third drives two seven-joint arms, with Pinocchio watching their trocars.

HPIPM and piqp are driven through CasADi, which has no soft rows: every slack is a control there.
With soft rows of its own HPIPM is set beside ours by ``make compare``.
"""

import os
import platform
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, thread_time
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.mpc.arm_loop import run_arms
from plumbline.experiments.mpc.closed_loop import point
from plumbline.experiments.reality.touch import Touch, all_pairs
from plumbline.optim import capsule_mpc as mpc
from plumbline.optim.capsule_mpc.constants import MM
from plumbline.optim.capsule_mpc.planning import native, shifted
from plumbline.optim.core.problem import Array

Line = dict[str, Any]  # of a table
# Of the course, [s] of a step, [mm] of clearance that is asked for.
STEPS, DT, SAFE = 300, 0.02, 2.0
SIZES = ((10, 3), (20, 10))  # steps of the horizon and obstacles
SOLVERS: dict[str, mpc.Planner] = {
    "banded": mpc.RealTime(),
    "hpipm by CasADi": mpc.RealTime(mpc.LibraryQp("hpipm")),
    "piqp by CasADi": mpc.RealTime(mpc.LibraryQp("piqp")),
    "one step": mpc.OneStep(),
    "fatrop": mpc.Nonlinear("fatrop"),
    "ipopt": mpc.Nonlinear("ipopt"),
}
ASKED = {  # median and p99 [ms]
    (10, "banded"): (0.6, 0.6),
    (20, "banded"): (0.7, 1.0),
    (10, "ipopt"): (6.6, 6.6),
    (20, "ipopt"): (6.6, 13.7),
}


def machine() -> str:
    """Processor, cores and versions, in one line."""
    names = ("casadi", "coal", "pin", "numpy", "scipy")
    chip = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        chip = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    code = "compiled" if native() else "not compiled"
    versions = ", ".join(f"{name} {version(name)}" for name in names)
    return f"{os.cpu_count()} cores {chip}, Python {platform.python_version()}, {versions}, {code}"


def instruments(count: int) -> tuple[mpc.TipInstrument, ...]:
    """Instruments whose trocars lie on a ring; two of them face each other."""
    angles = np.pi + 2 * np.pi * np.arange(count) / count
    radius = 45.0 if count < 5 else 70.0
    return tuple(
        mpc.TipInstrument(point(np.array([radius * np.cos(a), radius * np.sin(a), 0.0]) / MM))
        for a in angles
    )


def goals(bodies: tuple[mpc.TipInstrument, ...], time: float) -> Array:
    """Where the tips should be (g,) [mm]: to the other side and back in six seconds."""
    share = 0.7 * np.cos(2 * np.pi * time / 6.0)
    return np.concatenate(
        [
            [share * x, share * y + 2.0 * (-1) ** k, -115.0 - 3.0 * k]
            for k, (x, y, _) in enumerate(body.constants for body in bodies)
        ]
    )


def obstacles(count: int, time: float) -> list[mpc.Obstacle]:
    """Rods and spheres around the middle [mm]; the first sphere moves."""
    found = []
    for k in range(count):
        angle, far = 2.4 * k, 30.0 + 4.0 * (k % 5)
        middle = np.array([far * np.cos(angle), far * np.sin(angle), -135.0 - 2.0 * (k % 4)])
        if k == 0:
            swing = np.array([10.0 * np.sin(time), 0.0, 0.0])
            speed = np.array([10.0 * np.cos(time), 0.0, 0.0])
            place = np.array([0.0, 18.0, -90.0]) + swing
            found.append(mpc.Obstacle.sphere(point(place), 4.0, point(speed)))
        elif k % 2:
            along = np.array([-np.sin(angle), np.cos(angle), 0.3]) * 12.0
            found.append(mpc.Obstacle(point(middle - along), point(middle + along), 3.0))
        else:
            found.append(mpc.Obstacle.sphere(point(middle), 5.0))
    return found


def drive(name: str, planner: mpc.Planner, p: int, count: int, tools: int, steps: int) -> Line:
    """Drive the course once.

    Times of a step by the clock and of the thread alone [ms]; least clearance by coal [mm]; RMS
    distance of a tip from its moving goal [mm] and change of a rate [mm/s^2]; share of steps that
    were solved; the most that a plan fell short [mm].
    """
    bodies = instruments(tools)
    balls = sum(o.a == o.b for o in obstacles(count, 0.0))
    statement = mpc.Statement(bodies, count - balls, mpc.Settings(p=p, safe=SAFE / MM), balls)
    ready, wall, thread = planner.ready(statement), [0.0], [0.0]
    x = goals(bodies, 0.0)
    path, radii = np.tile(x, (p, 1)), [2.5] * tools + [o.radius for o in obstacles(count, 0.0)]
    touch = Touch(all_pairs(tools, count), np.array(radii))
    least, slack, solved, errors, rates = np.inf, 0.0, 0, [], [np.zeros(len(x))]
    for k in range(steps):
        seen = obstacles(count, DT * k)
        wanted = np.stack([goals(bodies, DT * (k + i + 1)) for i in range(p)])
        begun, own = perf_counter(), thread_time()
        plan = ready.plan(x, statement.stages(wanted, seen, DT * rates[-1]), path)
        thread.append(thread_time() - own)
        wall.append(perf_counter() - begun)
        solved, slack = solved + plan.solved, max(slack, plan.slack)
        rates.append((plan.x[0] - x) / DT)
        x, path = plan.x[0].copy(), shifted(plan.x)
        errors.append(np.linalg.norm((x - wanted[0]).reshape(-1, 3), axis=1))
        ends = _capsules(bodies, x, obstacles(count, DT * (k + 1)))
        least = min(least, float(touch.clearances(ends).min()))
    change = np.diff(rates, axis=0)[1:] / DT
    return {
        "solver": name, "p": p, "obstacles": count, "instruments": tools,
        **percentiles(wall[1:], ""), **percentiles(thread[1:], "thread "),
        "clearance": least, "tracking": float(np.sqrt(np.mean(np.square(errors)))),
        "acceleration": float(np.sqrt(np.mean(change**2))), "solved": solved / steps,
        "slack": slack,
    }  # fmt: skip


def _capsules(bodies: tuple[mpc.TipInstrument, ...], x: Array, seen: list[mpc.Obstacle]) -> Array:
    ends = []
    for body, tip in zip(bodies, x.reshape(-1, 3), strict=True):
        inside = tip - body.constants
        ends.append(np.stack([tip, tip - MM * body.length * inside / np.linalg.norm(inside)]))
    return np.concatenate([np.stack(ends), np.array([[o.a, o.b] for o in seen]).reshape(-1, 2, 3)])


def percentiles(seconds: list[float], before: str) -> dict[str, float]:
    """Median, 99th percentile and maximum [ms]; the first is left out, nothing is warm yet."""
    found = 1e3 * np.percentile(seconds[1:], [50.0, 99.0, 100.0])
    return dict(zip((f"{before}median", f"{before}p99", f"{before}max"), found, strict=True))


def arms(tasks: int) -> Line:
    """Two seven-joint arms over some tasks: times [ms], clearance and trocar's miss [mm]."""
    runs = [run_arms(seed) for seed in range(tasks)]
    return {
        "tasks": tasks, **percentiles([s for run in runs for s in run.seconds], ""),
        "clearance": min(run.clearance for run in runs), "rcm": max(run.rcm for run in runs),
        "reached": float(np.mean([run.reached for run in runs])),
    }  # fmt: skip


def measured(*, quick: bool) -> Found:
    """Measure everything; when quick, fewer steps, and what grows in two steps only."""
    steps = 60 if quick else STEPS
    driven = [
        [drive(name, planner, p, count, 2, steps) for _ in range(2)][-1]  # all built by the second
        for p, count in SIZES
        for name, planner in SOLVERS.items()
    ]
    for line in driven:
        line["asked"] = ASKED.get((line["p"], line["solver"]), "")
    horizons, crowds = ((5, 20), (0, 10)) if quick else ((5, 10, 20, 40), (0, 3, 10, 20, 40))
    tools = (2, 3) if quick else (2, 3, 4, 6)
    sizes = [*((p, 3, 2) for p in horizons), *((10, c, 2) for c in crowds)]
    sizes += [(10, 3, t) for t in tools]
    return {
        "machine": machine(),
        "one course, times of a step [ms]": pd.DataFrame(driven),
        "growth": pd.DataFrame([drive("banded", mpc.RealTime(), *s, steps) for s in sizes]),
        "two seven-joint arms": pd.DataFrame([arms(2 if quick else 6)]),
    }


@as_command
def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Fewer steps and sizes.")] = False,
) -> Found:
    """Measure time and quality, and print them beside what is asked."""
    return measured(quick=quick)


if __name__ == "__main__":
    typer.run(bench)

"""Time of the bounded link fit: ``python -m plumbline.experiments.benches.dh_fit [--quick]``.

Thirty simulated readings of the BH-7 and its 24 published parameters, every solver beside SciPy's
SLSQP with finite differences on the same compiled misfits, and 100,000 readings. Times are medians
of several runs within one process; the problem is stated once, before the clock starts.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Protocol

import typer
from rich.table import Table

from plumbline.experiments.benches import tell, timed
from plumbline.experiments.benches.dh_fit_scripts import (
    FiniteDifferenceLeastSquares,
    FiniteDifferenceSqp,
)
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.reality.tip_readings import draw_session
from plumbline.experiments.reproduce.dh_fit_sessions import (
    NOISE,
    PAPER,
    recording_of,
    registration_of,
)
from plumbline.optim.core.solvers import Solver
from plumbline.optim.dh_fit import SOLVERS, DHFit, DHOptions, Norms, Readings, Squares, fit_dh
from plumbline.optim.dh_fit.losses import Loss
from plumbline.optim.dh_fit.statement import Statement
from plumbline.optim.dh_fit.sums import Pass

READINGS, MANY = 30, 100_000
RUNS, SLOW_RUNS = 15, 3
MOST_SECONDS, LEAST_FASTER, MOST_SECONDS_MANY = 0.030, 20.0, 10.0


class Named(Solver, Protocol):
    """A solver with a name."""

    @property
    def name(self) -> str:
        """What the table calls it."""


@dataclass(frozen=True)
class Timed:
    """One solver on one problem."""

    solver: str  # its name
    loss: str  # what a misfit costs
    seconds: float  # median time [s]
    iterations: int  # steps taken
    objective: float  # F at its solution [m or m^2]
    excess: float  # F over the smallest F found, less one
    slsqp: float  # how many times faster than SLSQP with finite differences


@dataclass(frozen=True)
class Many:
    """A whole fit of many readings, from arrays to the report [s]."""

    readings: int
    loss: str
    solve: float
    whole: float
    misfit: float


@dataclass(frozen=True)
class Bench:
    """All that was measured; names of the fields are the keys of the JSON."""

    small: tuple[Timed, ...]
    many: tuple[Many, ...]


def small(loss: Loss, seed: int, *, quick: bool) -> tuple[Timed, ...]:
    """Every solver on 30 readings and the 24 published parameters."""
    before = 1e-3 * PAPER[0][0][0]
    session = draw_session(seed, readings=READINGS, before=before, noise=NOISE)
    options = DHOptions(loss=loss, frame="registration", parameters="all", hayati=False)
    fit = fit_dh(recording_of(session), options, registration=registration_of(session))
    baselines = (FiniteDifferenceSqp(), FiniteDifferenceLeastSquares())
    solvers: Sequence[Named] = (*SOLVERS, *baselines)
    found = []
    for solver in solvers:
        slow = solver.name != "gauss-newton"
        runs = (1 if quick else SLOW_RUNS) if slow else RUNS
        found.append(_timed(solver, fit.statement, fit.readings, runs))
    best = min(objective for _, _, _, objective in found)
    slsqp = next(s for name, s, _, _ in found if name == FiniteDifferenceSqp().name)
    return tuple(
        Timed(name, loss.name, seconds, steps, f, f / best - 1.0, slsqp / seconds)
        for name, seconds, steps, f in found
    )


def _timed(
    solver: Named, statement: Statement, readings: Readings, runs: int
) -> tuple[str, float, int, float]:
    # Of several runs the first compiles and is not counted.
    count = runs + (runs > 1)
    found, times = timed(
        lambda: solver.solve(statement.problem(readings), statement.nominal), count
    )
    objective = Pass(statement, readings).objective(found.x)
    return solver.name, statistics.median(times[-runs:]), found.iterations, objective


def many(loss: Loss, seed: int, count: int = MANY) -> Many:
    """A whole fit of many readings, frame free and links as far as they can be told."""
    session = draw_session(seed, readings=count, before=7e-3, noise=NOISE, box=None)
    recording = recording_of(session)

    def whole() -> tuple[DHFit, float]:
        fit = fit_dh(recording, DHOptions(loss=loss))
        return fit, fit.after.rms

    (fit, misfit), (took,) = timed(whole)
    statement, solver = fit.statement, fit.options.solver
    _, (alone,) = timed(lambda: solver.solve(statement.problem(fit.readings), statement.nominal))
    return Many(count, loss.name, alone, took, misfit)


def tables(bench: Bench) -> list[Table]:
    """What was measured, with the targets."""
    first = Table("loss", "solver", "time", "steps", "over the best", "x SLSQP")
    first.title = f"{READINGS} readings, 24 parameters"
    for t in bench.small:
        row = (f"{1e3 * t.seconds:.1f} ms", f"{t.iterations}", f"{t.excess:.0e}", f"{t.slsqp:.1f}")
        first.add_row(t.loss, t.solver, *row)
    fastest = min(bench.small, key=lambda t: t.seconds)
    first.caption = (
        f"best {1e3 * fastest.seconds:.1f} ms, {fastest.slsqp:.0f} times faster than SLSQP; hoped "
        f"for: at most {1e3 * MOST_SECONDS:g} ms, at least {LEAST_FASTER:g} times"
    )
    second = Table("readings", "loss", "solver alone", "whole fit", "RMS left")
    second.title = "Many readings"
    for m in bench.many:
        cells = (f"{m.solve:.2f} s", f"{m.whole:.2f} s", f"{1e3 * m.misfit:.3f} mm")
        second.add_row(f"{m.readings:,}", m.loss, *cells)
    second.caption = f"hoped for: at most {MOST_SECONDS_MANY:g} s"
    return [first, second]


def bench(
    quick: Annotated[bool, typer.Option("--quick", help="One run of what is slow.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    json: Json = None,
) -> None:
    """Measure the time of the link fit, and print it beside what is hoped for."""

    def measure() -> Bench:
        losses: tuple[Loss, ...] = (Norms(), Squares())
        timed = tuple(t for loss in losses for t in small(loss, seed, quick=quick))
        return Bench(timed, tuple(many(loss, seed) for loss in losses))

    tell(measure, tables, json)


if __name__ == "__main__":
    typer.run(bench)

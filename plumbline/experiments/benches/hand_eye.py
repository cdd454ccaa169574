"""Time of the hand-eye solves: ``python -m plumbline.experiments.benches.hand_eye [--json OUT]``.

One simulated set-up of 180 readings on three planes. How long does the joint problem of three
planes take once its functions are compiled, and how much longer do SciPy's trust region with finite
differences on the same residuals, and on eq. 5 written in NumPy? Medians of one run; the first call
of each is left out, and ratios are within the run, since machines differ. Times are those of the
processor, which a machine shared with others does not stretch.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

import typer
from rich.table import Table
from scipy.optimize import least_squares

from plumbline.experiments.benches import tell, timed
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.reproduce.hand_eye_trials import set_up
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.solvers import Ipopt
from plumbline.optim.hand_eye.baselines import scipy_direct
from plumbline.optim.hand_eye.beam import Array, mean_beam
from plumbline.optim.hand_eye.calibrate import calibrate
from plumbline.optim.hand_eye.rows import Frames
from plumbline.optim.hand_eye.single_plane import closed_form
from plumbline.optim.hand_eye.three_planes import Weights, solve_three_planes, state, statement

RUNS = 30
MOST_SECONDS = 0.020  # of the three-plane solve


@dataclass(frozen=True)
class Line:
    """One way of doing it."""

    what: str  # which
    seconds: float  # median time [s]
    first: float  # time of the first call, with nothing compiled [s]
    ratio: float  # median time over that of the three planes by Levenberg-Marquardt


@dataclass(frozen=True)
class Bench:
    """All that was measured; names of the fields are the keys of the JSON."""

    lines: tuple[Line, ...]
    most_seconds: float
    met: bool


def measure(seed: int = 0) -> Bench:
    """Time every way on one set-up."""
    readings = set_up(seed, 0).readings
    singles = [closed_form(readings.on_plane(int(k))) for k in readings.planes]
    start = mean_beam([s.beam for s in singles])
    frames = Frames.of(readings, start)
    mapped = Mapped(state(readings, frames, Weights()))
    first = statement(len(frames.c)).start(start, frames)

    def residuals(x: Array) -> Array:
        return mapped.residuals(x).ravel()

    def finite_differences() -> object:
        return least_squares(
            residuals, first, jac="2-point", x_scale=mapped.problem.scale,
            ftol=1e-11, xtol=1e-11, gtol=1e-11,
        )  # fmt: skip

    ways: list[tuple[str, Callable[[], object]]] = [
        ("three planes, Levenberg-Marquardt", lambda: solve_three_planes(readings, singles)),
        ("three planes, IPOPT with constraints",
         lambda: solve_three_planes(readings, singles, solver=Ipopt())),
        ("three planes, SciPy with finite differences", finite_differences),
        ("eq. 5 in NumPy, SciPy with finite differences", lambda: scipy_direct(readings, start)),
        ("closed form, one plane", lambda: closed_form(readings.on_plane(1))),
        ("ours: robust, bowed boards, variances", lambda: calibrate(readings)),
    ]  # fmt: skip
    times = [timed(way, RUNS + 1, process_time)[1] for _, way in ways]
    medians = [statistics.median(later) for _, *later in times]
    base = medians[0]
    lines = tuple(
        Line(what, median, once[0], median / base)
        for (what, _), once, median in zip(ways, times, medians, strict=True)
    )
    return Bench(lines, MOST_SECONDS, base <= MOST_SECONDS)


def tables(found: Bench) -> list[Table]:
    """What was measured."""
    table = Table(title="180 readings, 3 planes", title_justify="left")
    for heading in ("way", "median [ms]", "first call [ms]", "ratio"):
        table.add_column(heading, justify="left" if heading == "way" else "right")
    for line in found.lines:
        times = (f"{line.seconds * 1e3:.1f}", f"{line.first * 1e3:.1f}")
        table.add_row(line.what, *times, f"{line.ratio:.2f}")
    return [table]


def main(json: Json = None, seed: int = 0) -> None:
    """Time the hand-eye solves."""
    tell(lambda: measure(seed), tables, json)


if __name__ == "__main__":
    typer.run(main)

"""Time of registrations: ``python -m plumbline.experiments.benches.registration``.

Is the three-point frame of many noisy triples, its symbols mapped, faster than a loop over them,
and than Kabsch's rotation of the same triples at once? Is one three-point frame faster than one
least-squares fit of 3, 4 and 5 markers, as its authors found (about 40 %)? Both are answered by
ratios of medians within one run, since machines differ; the ways take turns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import typer
from rich.table import Table

from plumbline.experiments.benches import tell, timed
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.reproduce.registration_timing import Ratio, ratios
from plumbline.experiments.reproduce.registration_trial import MARKERS, Trial, noise
from plumbline.optim.core.problem import Array
from plumbline.optim.registration import (
    Anisotropic,
    Kabsch,
    Method,
    RegistrationOptions,
    ThreePoint,
    build_fiducials,
    register,
)
from plumbline.optim.registration.three_point import three_point_batch
from plumbline.optim.rigid import rigid_match

PART = 50  # of the triples, every so manieth goes through the loop
LEAST_OVER_LOOP, LEAST_OVER_KABSCH = 50.0, 1.0
T_RC = np.array([[0.0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Line:
    """One way of doing it."""

    what: str  # which
    seconds: float  # median time [s]
    ratio: float  # that time over the three-point frame's in the same group


@dataclass(frozen=True)
class Bench:
    """All that was measured."""

    triples: int  # how many noisy triples
    batch: tuple[Line, ...]  # the same triples by different means
    singles: dict[str, Ratio]  # least squares over the three-point frame, one by one and at once
    answers: tuple[Line, ...]  # one registration with all its checks and predicted errors


def numpy_frame(ct: Array, robot: Array) -> Array:
    """``T_RC`` (4, 4) of three markers (3, 3) [m], as one would write it in NumPy at first."""
    frames = []
    for m in (ct, robot):
        e1, side = m[1] - m[0], m[2] - m[0]
        e1 = e1 / np.sqrt(e1 @ e1)
        e3 = np.cross(e1, side)
        e3 = e3 / np.sqrt(e3 @ e3)
        frames.append(np.array((e1, np.cross(e3, e1), e3)))
    T = np.eye(4)
    T[:3, :3] = frames[1].T @ frames[0]
    T[:3, 3] = robot[0] - T[:3, :3] @ ct[0]
    return T


def lines(ways: dict[str, Callable[[], object]], rounds: int) -> list[Line]:
    """Median times of several ways; they take turns, so that a busy machine slows all of them."""
    seconds = [[timed(run)[1][0] for run in ways.values()] for _ in range(rounds)]
    medians = np.median(seconds, axis=0)
    return [
        Line(what, float(t), float(t / medians[0])) for what, t in zip(ways, medians, strict=True)
    ]


def batch_of(trial: Trial, rounds: int) -> list[Line]:
    """The same noisy triples at once, by Kabsch at once, and in a loop (a part of them, scaled)."""
    ct, robot = trial.chosen("ABC")
    part = max(len(ct) // PART, 1)

    def loop() -> list[Array]:
        return [numpy_frame(c, r) for c, r in zip(ct[:part], robot[:part], strict=True)]

    *whole, slow = lines(
        {
            "three-point, all at once": lambda: three_point_batch(ct, robot),
            "Kabsch, all at once (batched SVD)": lambda: rigid_match(ct, robot),
            f"three-point, loop in NumPy (from {part:,})": loop,
        },
        rounds,
    )
    scale = len(ct) / part
    return [*whole, Line(slow.what, slow.seconds * scale, slow.ratio * scale)]


def answers_of(rounds: int) -> list[Line]:
    """One registration as the library gives it: checked, with its errors predicted."""
    ct = np.array(list(MARKERS.values()))
    robot = ct @ T_RC[:3, :3].T
    methods: list[tuple[Method, int]] = [(ThreePoint(), 3), (Kabsch(), 3), (Kabsch(), 4)]
    methods += [(Kabsch(), 5), (Anisotropic(), 5)]
    ways: dict[str, Callable[[], object]] = {}
    for method, n in methods:
        recording = build_fiducials(ct[:n], robot[:n], noise=noise())
        once = partial(register, recording, RegistrationOptions(method))
        ways[f"{method.name} of {n} markers"] = once
    return lines(ways, rounds)


def measured(count: int = 100_000, rounds: int = 9, seed: int = 0) -> Bench:
    """Measure everything."""
    trial = Trial.drawn(T_RC, count, np.random.default_rng(seed), normal=True)
    batch, singles = batch_of(trial, rounds), ratios(trial.first(count // PART))
    return Bench(count, tuple(batch), singles, tuple(answers_of(3 * rounds)))


def tables(bench: Bench) -> list[Table]:
    """What was measured, with what was hoped for."""
    kabsch, loop = bench.batch[1].ratio, bench.batch[2].ratio
    hoped = (
        f"over Kabsch x {kabsch:.1f}, hoped for: at least {LEAST_OVER_KABSCH:g}; "
        f"over the loop in NumPy x {loop:.0f}, hoped for: at least {LEAST_OVER_LOOP:g}"
    )
    found = []
    for title, group, caption in (
        (f"{bench.triples:,} noisy triples", bench.batch, hoped),
        ("One registration, checked, with its predicted errors", bench.answers, ""),
    ):
        table = Table("how", "time", "over three-point", title=title, caption=caption)
        for line in group:
            table.add_row(line.what, f"{line.seconds * 1e3:.2f} ms", f"x {line.ratio:.2f}")
        found.append(table)
    single = Table("baseline", "one by one", "saved", title="Time over the three-point frame's")
    single.caption = "claimed by its authors: 40 % saved"
    for name, ratio in bench.singles.items():
        single.add_row(name, f"x {ratio.single:.2f}", f"{100 * (1 - 1 / ratio.single):.0f} %")
    return [*found, single]


def bench(json: Json = None) -> None:
    """Measure the time of registrations, and print it beside what is hoped for."""
    tell(measured, tables, json)


if __name__ == "__main__":
    typer.run(bench)

"""Time of registrations: ``python -m plumbline.experiments.benches.registration``.

Two questions, both answered by ratios of medians within one run, since machines differ. Is the
three-point frame of many noisy triples, its symbols mapped, faster than a loop over them, and than
Kabsch's rotation of the same triples at once? And is one three-point frame faster than one
least-squares fit of 3, 4 and 5 markers, as its authors found (about 40 %)? For the second, both are
written twice: in a few NumPy calls each, as one would at first, and in plain numbers, where only
the eigenvector of Horn's quaternion fit (Horn 1987, JOSA A 4(4)) is left to NumPy.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter

import numpy as np
import typer
from rich.table import Table

from plumbline.experiments.benches import tell
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.reproduce.registration_timing import least_squares_once
from plumbline.optim.core.problem import Array
from plumbline.optim.registration import (
    Anisotropic,
    Kabsch,
    MarkerNoise,
    Method,
    RegistrationOptions,
    ThreePoint,
    build_fiducials,
    register,
)
from plumbline.optim.registration.three_point import three_point_batch
from plumbline.optim.rigid import rigid_match

Ways = list[tuple[str, Callable[[], object]]]
Row = list[float]
Rows = list[list[float]]
# Markers A to E of Chen Guangbiao et al., table 1, CT coordinates [m].
MARKERS = 1e-3 * np.array(
    [[10, 20, 147], [110, 120, 147], [60, -10, 80], [90, -10, 20], [20, 150, 147]], dtype=float
)
STD = 1e-3  # [m]
LEAST_OVER_LOOP, LEAST_OVER_KABSCH = 50.0, 1.0


@dataclass(frozen=True)
class Line:
    """One way of doing it.

    Attributes:
        what: Which.
        seconds: Median time [s].
        ratio: That time over the three-point frame's in the same group.
    """

    what: str
    seconds: float
    ratio: float


@dataclass(frozen=True)
class Bench:
    """All that was measured.

    Attributes:
        triples: How many noisy triples.
        batch: The same triples by different means.
        in_numpy: One registration, both in NumPy calls.
        in_numbers: One registration, both in plain numbers.
        answers: One registration with all its checks and predicted errors.
    """

    triples: int
    batch: tuple[Line, ...]
    in_numpy: tuple[Line, ...]
    in_numbers: tuple[Line, ...]
    answers: tuple[Line, ...]


def numpy_frame(ct: Array, robot: Array) -> Array:
    """``T_RC`` (4, 4) of three markers, as one would write it in NumPy."""
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


def plain_frame(ct: Rows, robot: Rows) -> Rows:
    """Rotation (3, 3) and translation of three markers, in plain numbers: four rows."""
    axes = []
    for m in (ct, robot):
        a, b = _minus(m[1], m[0]), _minus(m[2], m[0])
        e1 = _unit(a)
        e3 = _unit(_cross(e1, b))
        axes.append((e1, _cross(e3, e1), e3))
    C, R = axes
    turn = [[sum(R[k][i] * C[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
    return [*turn, [robot[0][i] - _dot(turn[i], ct[0]) for i in range(3)]]


def plain_horn(ct: Rows, robot: Rows) -> Rows:
    """The same by least squares of n markers: Horn's quaternion, all but its eigenvector plain."""
    n = len(ct)
    p = [sum(m[i] for m in ct) / n for i in range(3)]
    q = [sum(m[i] for m in robot) / n for i in range(3)]
    A, B = [_minus(m, p) for m in ct], [_minus(m, q) for m in robot]
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (
        [sum(a[i] * b[j] for a, b in zip(A, B, strict=True)) for j in range(3)] for i in range(3)
    )
    N = [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ]
    w, x, y, z = np.linalg.eigh(N)[1][:, 3].tolist()
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return [*turn, [q[i] - _dot(turn[i], p) for i in range(3)]]


def _minus(a: Row, b: Row) -> Row:
    return [a[0] - b[0], a[1] - b[1], a[2] - b[2]]


def _dot(a: Row, b: Row) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _unit(a: Row) -> Row:
    length = math.sqrt(_dot(a, a))
    return [a[0] / length, a[1] / length, a[2] / length]


def _cross(a: Row, b: Row) -> Row:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def timed(run: Callable[[], object], inner: int) -> float:
    """Seconds of one run, from several in a row."""
    start = perf_counter()
    for _ in range(inner):
        run()
    return (perf_counter() - start) / inner


def drawn(count: int, seed: int) -> tuple[Array, Array]:
    """Noisy triples A-B-C in both frames (count, 3, 3) [m]."""
    rng = np.random.default_rng(seed)
    shape = (count, 3, 3)
    ct = MARKERS[:3] + rng.normal(0.0, STD, shape)
    return ct, MARKERS[:3, [1, 0, 2]] * (1, 1, -1) + rng.normal(0.0, STD, shape)


def lines(ways: Ways, rounds: int, inner: int) -> list[Line]:
    """Median times of several ways; they take turns, so that a busy machine slows all of them."""
    seconds: list[list[float]] = [[] for _ in ways]
    for _ in range(rounds):
        for k, (_, run) in enumerate(ways):
            seconds[k].append(timed(run, inner))
    medians = [statistics.median(s) for s in seconds]
    return [Line(what, t, t / medians[0]) for (what, _), t in zip(ways, medians, strict=True)]


def batch_of(count: int, rounds: int, seed: int) -> list[Line]:
    """The same noisy triples at once, by Kabsch at once, and in a loop (a part of them, scaled)."""
    ct, robot = drawn(count, seed)
    part = max(count // 50, 1)

    def loop() -> list[Array]:
        return [numpy_frame(c, r) for c, r in zip(ct[:part], robot[:part], strict=True)]

    c, r = ct[:part].tolist(), robot[:part].tolist()

    def plain_loop() -> list[Rows]:
        return [plain_frame(a, b) for a, b in zip(c, r, strict=True)]

    found = lines(
        [
            ("three-point, all at once", lambda: three_point_batch(ct, robot)),
            ("Kabsch, all at once (batched SVD)", lambda: rigid_match(ct, robot)),
            (f"three-point, loop in NumPy (from {part:,})", loop),
            (f"three-point, loop in plain numbers (from {part:,})", plain_loop),
        ],
        rounds,
        1,
    )
    scale = count / part
    loops = [Line(slow.what, slow.seconds * scale, slow.ratio * scale) for slow in found[-2:]]
    return [*found[:-2], *loops]


def single_of(rounds: int) -> tuple[list[Line], list[Line]]:
    """One frame beside one least-squares fit of 3, 4 and 5 markers, written in two ways."""
    robot = MARKERS[:, [1, 0, 2]] * (1, 1, -1)
    c, r = MARKERS.tolist(), robot.tolist()
    in_numpy: Ways = [("three-point", partial(numpy_frame, MARKERS[:3], robot[:3]))]
    in_numbers: Ways = [("three-point", partial(plain_frame, c[:3], r[:3]))]
    for n in (3, 4, 5):
        what = f"least squares, {n} markers"
        in_numpy.append((what, partial(least_squares_once, MARKERS[:n], robot[:n])))
        in_numbers.append((what, partial(plain_horn, c[:n], r[:n])))
    return lines(in_numpy, rounds, 50), lines(in_numbers, rounds, 50)


def answers_of(rounds: int) -> list[Line]:
    """One registration as the library gives it: checked, with its errors predicted."""
    robot = MARKERS[:, [1, 0, 2]] * (1, 1, -1)
    noise = MarkerNoise.from_resolution([5e-3, 1e-3, 1e-3], 3e-4)
    methods: list[tuple[Method, int]] = [(ThreePoint(), 3), (Kabsch(), 3), (Kabsch(), 4)]
    methods += [(Kabsch(), 5), (Anisotropic(), 5)]
    ways: Ways = []
    for method, n in methods:
        recording = build_fiducials(MARKERS[:n], robot[:n], noise=noise)
        once = partial(register, recording, RegistrationOptions(method))
        ways.append((f"{method.name} of {n} markers", once))
    return lines(ways, rounds, 1)


def measured(count: int = 100_000, rounds: int = 9, seed: int = 0) -> Bench:
    """Measure everything."""
    in_numpy, in_numbers = single_of(10 * rounds)
    batch, answers = batch_of(count, rounds, seed), answers_of(3 * rounds)
    return Bench(count, tuple(batch), tuple(in_numpy), tuple(in_numbers), tuple(answers))


def tables(bench: Bench) -> list[Table]:
    """What was measured, with what was hoped for."""
    groups = (
        (f"{bench.triples:,} noisy triples", bench.batch, 1e3, "ms", _targets(bench)),
        ("One registration, in NumPy calls", bench.in_numpy, 1e6, "µs", _claim(bench.in_numpy)),
        ("One registration, in plain numbers", bench.in_numbers, 1e6, "µs",
         _claim(bench.in_numbers)),
        ("One registration, checked, with its predicted errors", bench.answers, 1e3, "ms", ""),
    )  # fmt: skip
    found = []
    for title, group, factor, unit, caption in groups:
        table = Table("how", "time", "over three-point", title=title, caption=caption)
        for line in group:
            table.add_row(line.what, f"{line.seconds * factor:.2f} {unit}", f"x {line.ratio:.2f}")
        found.append(table)
    return found


def _targets(bench: Bench) -> str:
    kabsch, loop = bench.batch[2].ratio, bench.batch[3].ratio
    return (
        f"over Kabsch x {kabsch:.1f}, hoped for: at least {LEAST_OVER_KABSCH:g}; "
        f"over the loop in NumPy x {loop:.0f}, hoped for: at least {LEAST_OVER_LOOP:g}"
    )


def _claim(group: Sequence[Line]) -> str:
    """The share of time that the three-point frame saves; its authors say about 40 %."""
    saved = [f"{100 * (1 - 1 / line.ratio):.0f} %" for line in group[1:]]
    return f"saved against least squares of 3, 4, 5 markers: {', '.join(saved)} (claimed: 40 %)"


def bench(json: Json = None) -> None:
    """Measure the time of registrations, and print it beside what is hoped for."""
    tell(measured, tables, json)


if __name__ == "__main__":
    typer.run(bench)

r"""Columns that are another joint's, or count the other way: told by what they run with.

What joint i was told or its model foretells, :math:`a_i`, and what was read in column j,
:math:`b_j`, run with each other by the cosine of their angle,

.. math:: c_{ij} = a_i^T b_j / (|a_i|\,|b_j|)

A column with its sign turned, or two that are exchanged, are refused where they run with the joint
so much better than as they stand that no gap or friction could make it. Of two joints that carry
the same weight sizes tell which is which, too: with :math:`s = |a_i| / |b_j|` columns are apart by

.. math:: d_{ij} = \tfrac12 \frac{|a_i - b_j|^2}{|a_i|\,|b_j|}
          = 1 - c_{ij} + \tfrac12 \left(s + \tfrac1s\right) - 1

Each cosine is that of the delay at which it is largest: what obeys fast motions late hardly runs
with them as it stands. Late by half a period a joint runs against one sine as well, so a sign is
told only where no delay does as much.

Logs that repeat their last reading while joints are under way: rows that nobody measured.

Velocities and accelerations beside the columns that they rate: is each what it says?

By the clock a rate goes from row to row as its column does, :math:`\tfrac12 (v_k + v_{k+1})
\Delta t_k` as :math:`q_{k+1} - q_k`. In another unit these are in one ratio, of another joint they
run with that one's, turned they run against it. What runs with the column itself, and not with how
it changes, is no rate of it: both hold places, or both velocities.
"""

from itertools import combinations

import numpy as np

from plumbline.errors import fault
from plumbline.optim.recording import constants
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import Array, Origin


def refuse_mixed_up(
    expected: Array, read: Array, letters: tuple[str, str], origin: Origin, latest: int = 0
) -> None:
    """Refuse columns that run against their joint, or two of them that run with the other's.

    What each joint was told, or its model foretells, and what was read of it are (N, n);
    ``letters`` are what their columns are called, and readings may follow ``latest`` rows late.
    """
    told, name = letters
    c, turned = _cosines(expected, read, latest)
    for j in range(len(c)):
        if 1.0 - c[j, j] >= max(constants.MIXED_UP * (1.0 - turned[j, j]), constants.ROUNDING):
            found = f"{name}{j + 1} against {told}{j + 1} (cosine {-turned[j, j]:.2f})"
            mend = "turn the sign of this column"
            raise fault(origin.at(f"{name}{j + 1}"), found, "columns that run together", mend)
    off = _apart(expected, read, c)
    for i, j in combinations(range(len(c)), 2):
        crossed = max(off[i, j], off[j, i])
        # Joints that all do the same run with each other as with themselves.
        if min(off[i, i], off[j, j]) >= max(constants.MIXED_UP * crossed, constants.ROUNDING):
            found = f"{name}{i + 1} with {told}{j + 1}, and {name}{j + 1} with {told}{i + 1}"
            mend = "exchange these columns"
            raise fault(origin.at(f"{name}{i + 1}"), found, "each with its own joint", mend)


def _apart(expected: Array, read: Array, c: Array) -> Array:
    """How far columns (n, n) are apart, by direction and by size; one where a column is zero."""
    a, b = (np.linalg.norm(x, axis=0) for x in (expected, read))
    both, mean = np.outer(a, b), np.add.outer(a**2, b**2) / 2.0
    return np.asarray(np.divide(mean, both, out=np.ones_like(both), where=both > 0.0) - c)


def latest_cosine(expected: Array, read: Array, latest: int) -> float:
    """The largest cosine of what was read (N,) with what was told, so many rows late or fewer."""
    rows = len(read)
    spectrum = np.fft.rfft(read, 2 * rows) * np.fft.rfft(expected, 2 * rows).conj()
    late = np.fft.irfft(spectrum, 2 * rows)[: min(latest + 1, rows)]
    late *= rows / (rows - np.arange(len(late)))  # as many as meet
    return float(late.max() / max(np.linalg.norm(expected) * np.linalg.norm(read), 1e-300))


def _cosines(expected: Array, read: Array, latest: int) -> tuple[Array, Array]:
    """Largest cosines (n, n) of columns, so many rows late or fewer, and of turned ones.

    Of the rows that meet, about their means where they may be late; zero where a column is.
    """
    rows, kept = len(read), min(latest, len(read) // 2) + 1
    meet = (rows - np.arange(kept))[:, None]
    first, last = expected, read[::-1]  # of which as many are left as rows meet
    sums = [np.cumsum(x, axis=0)[meet[:, 0] - 1] * (latest > 0) for x in (first, last)]
    squares = [np.cumsum(x * x, axis=0)[meet[:, 0] - 1] for x in (first, last)]
    told, seen = (np.fft.rfft(x, 2 * rows, axis=0) for x in (expected, read))
    sizes = [np.maximum(q - m * m / meet, 0.0) ** 0.5 for q, m in zip(squares, sums, strict=True)]
    ends = []
    for i, a in enumerate(told.T):
        both = np.fft.irfft(seen * a.conj()[:, None], 2 * rows, axis=0)[:kept]
        both -= sums[0][:, [i]] * sums[1] / meet
        late = both / np.maximum(sizes[0][:, [i]] * sizes[1], 1e-300)
        ends.append((late.max(axis=0), -late.min(axis=0)))
    found = np.clip(np.array(ends), -1.0, 1.0)
    return found[:, 0], found[:, 1]


def refuse_repeated(told: Array, read: Array, letter: str, origin: Origin) -> None:
    """Refuse readings (N, n) that stand while commands (N, n) and joints are under way."""
    step = np.diff(read, axis=0)
    new, asked = np.any(step != 0.0, axis=1), np.any(np.diff(told, axis=0) != 0.0, axis=1)
    rows, size = np.flatnonzero(new), np.abs(step[new])
    least = np.where(size > 0.0, size, np.inf).min(axis=0, initial=np.inf)
    low, high = np.minimum(size[:-1], size[1:]), np.maximum(size[:-1], size[1:])
    onwards = step[rows[:-1]] * step[rows[1:]] > 0.0
    even = onwards & (low >= constants.UNDER_WAY * least) & (high < constants.EVEN * low)
    same = np.diff(np.cumsum(asked & ~new)[rows])[moves := even.any(axis=1)]
    count = same.sum() + len(same)
    if same.sum() > max(constants.REPEATED * count, constants.FEW):
        first = rows[:-1][moves][np.argmax(same > 0)] + 2
        found = f"{same.sum()} of {count} rows repeat all readings as joints move"
        mend = "log both at one rate, or delete the rows that bring no new reading"
        raise fault(origin.at(f"{letter}1", first), found, "a reading a row", mend)


def refuse_other_rates(r: Recording, origin: Origin) -> None:
    """Refuse rates that are in another unit, another joint's, turned, or no rates at all."""
    step = np.diff(r.time if r.time is not None else [])[:, None]
    for name, rate, place in (
        ("velocity", r.velocity, r.q), ("acceleration", r.acceleration, r.velocity),
    ):  # fmt: skip
        if rate is None or place is None or not (step > 0).any():
            continue
        usual = (step > 0) & (step < constants.GAP_IN_TIME * np.median(step[step > 0]))
        moved = np.where(usual, np.diff(place, axis=0), 0.0)
        told = np.where(usual, step * (rate[1:] + rate[:-1]) / 2, 0.0)
        names = name, "q" if place is r.q else "velocity"
        latest = round(constants.LATEST / float(np.median(step[step > 0])))
        columns = zip(told.T, moved.T, (rate - rate.mean(axis=0)).T, place.T, strict=True)
        for joint, (way, move, its, own) in enumerate(columns, start=1):
            called = f"{names[0]}{joint}", f"{names[1]}{joint}"
            _refuse_other_unit((way, move), called, origin)
            run = latest_cosine(move, way, latest), latest_cosine(own - own.mean(), its, 0)
            _refuse_no_rate(run, called, origin)
        refuse_mixed_up(moved, told, (names[1], name), origin, latest)


def _refuse_no_rate(run: tuple[float, float], names: tuple[str, str], origin: Origin) -> None:
    """Refuse a rate that runs (cosine) not with how its column changes but with that itself."""
    far, near = 1.0 - run[0], 1.0 - run[1]
    if near < 1.0 - constants.ONE_COURSE and far >= constants.MIXED_UP * near:
        found = f"{names[0]} that runs with {names[1]} itself, not with how it changes"
        mend = "write what each name says into its column"
        raise fault(origin.at(names[0]), found, "a rate", mend)


def _refuse_other_unit(ways: tuple[Array, Array], names: tuple[str, ...], origin: Origin) -> None:
    """Refuse a rate whose ways (N,) from row to row are those of its column in another unit."""
    sizes = [float(np.linalg.norm(way)) for way in ways]
    if not ways[0] @ ways[1] > constants.ONE_COURSE * sizes[0] * sizes[1] > 0.0:
        return
    factor = sizes[0] / sizes[1]
    if not 1 / constants.NEAR_SCALE < factor < constants.NEAR_SCALE:
        large, other = names if factor > 1 else names[::-1]
        found = f"{max(factor, 1 / factor):.3g} times what {other} has it by the clock"
        mend = "divide by 57.3 if in degrees; in ms, divide time by 1000"
        raise fault(origin.at(large), found, "rates of one unit", mend)

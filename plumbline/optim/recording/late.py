r"""Channels of one log that are read late: what is found of a motion by how it runs with another.

What a channel should read is a combination of columns, :math:`y_j(t) = X_j(t - d)\,\theta_j`, and
how late it is the same for all joints. Of n readings, noise and all, with columns of k rows before,
the logarithm of the likelihood of any :math:`\theta` (Harville 1974) is

.. math:: L(k) = -\sum_j \frac{n - p_j}{2 \tau_j} \log \min_\theta |y_j - X_j(t - k h)\, \theta_j|^2

with the number :math:`p_j` of columns and the correlation time :math:`\tau_j` of what is left: a
few rows that as many columns fit say nothing. The readings are the same at every k: other readings
have other noise, which would be held for lateness. Between rows each joint's squares run by
the parabola through the best three. A channel is late where that is by :data:`SURELY_LATE` more
probable than that it is not, whichever joint is not asked: one alone may have friction with a
memory.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from plumbline.optim.recording import constants
from plumbline.optim.recording.derivatives import stretches, usual_step
from plumbline.optim.recording.table import Array, Flags, Indices

Rows = Indices
Designs = Callable[[Rows], Sequence[Array]]


def late_by(time: Array, read: Array, designs: Designs) -> float:
    """How much later than its rows a channel (N, n) is read [s]; zero where that is not sure.

    ``designs`` of rows (k,) are orthonormal columns (k, p) that each joint's reading is made of.
    """
    late, gain = likeliest(time, read, designs)
    sure = gain > constants.SURELY_LATE and abs(late) > constants.LEAST * usual_step(time)
    return late if sure else 0.0


def likeliest(time: Array, read: Array, designs: Designs) -> tuple[float, float]:
    """The same [s], sure or not, and how much more probable that is without whom it is most to."""
    step = usual_step(time)
    most = round(constants.LATEST / step)
    rows = rows_asked(time, most)
    if most < 1 or len(rows) < constants.FEWEST_EFFORTS:
        return 0.0, 0.0
    found = best_place(read, rows, designs(around(rows, most)), most)
    gains = found.effective / 2.0 * np.log(found.unmoved / found.square)
    return step * found.rows, float(gains.sum() - gains.max())


def rows_asked(time: Array, most: int) -> Rows:
    """Rows (k,) that have so many others of their run on either side; of many some long blocks."""
    parts = [s[most : len(s) - most] for s in stretches(time, usual_step(time))]
    rows = np.concatenate(parts)
    if len(rows) <= constants.EFFORT_ROWS or most < 1:
        return rows
    blocks = max(constants.EFFORT_ROWS // (constants.BLOCK * most), constants.FEWEST_BLOCKS)
    length = constants.EFFORT_ROWS // blocks
    first = np.linspace(0, len(rows) - length, blocks).astype(np.int64)
    return rows[np.unique(first[:, None] + np.arange(length))]


def around(rows: Rows, most: int) -> Rows:
    """These rows and as many on either side."""
    return np.unique(rows[:, None] + np.arange(-most, most + 1))


@dataclass(frozen=True, eq=False)
class Place:
    """Where a channel runs with its designs the best, of all that are tried."""

    rows: float  # so many later
    square: Array  # mean square of what is left there of each joint's readings (n,)
    unmoved: Array  # the same in its own place (n,)
    effective: Array  # rows that count as independent (n,)


def best_place(read: Array, rows: Rows, designs: Sequence[Array], most: int) -> Place:
    """The place in rows, so many at most either way, and between them.

    ``designs`` are of the rows :func:`around` these.
    """
    shifts = np.arange(-most, most + 1)
    at = np.searchsorted(around(rows, most), rows)
    each = [_left(read[rows, j], X, at, shifts) for j, X in enumerate(designs)]
    left = np.array(each).swapaxes(0, 1)
    past = left[np.argmin(np.log(left[..., 0]).sum(axis=-1)), :, 1]
    free = len(rows) - np.array([X.shape[1] for X in designs])
    effective = np.maximum(free, 0) * (1.0 - past) / (1.0 + past)
    best = int(np.clip(np.argmin(np.log(left[..., 0]) @ effective), 1, len(shifts) - 2))
    before, there, after = left[best - 1 : best + 2, :, 0]
    off = np.linspace(-1.0, 1.0, constants.FINE)[:, None]
    between = there + off * (after - before) / 2.0 + off**2 * (before - 2.0 * there + after) / 2.0
    between = np.maximum(between, 1e-300)
    found = int(np.argmin(np.log(between) @ effective))
    return Place(float(shifts[best] + off[found, 0]), between[found], left[most, :, 0], effective)


def at_other_time(time: Array, columns: Array, by: float) -> tuple[Array, Flags]:
    """Columns (N, k) so much later [s], and which rows (N,) have any."""
    found, there = columns.copy(), np.zeros(len(columns), bool)
    for s in stretches(time, usual_step(time)):
        t, first = np.unique(time[s], return_index=True)
        later = time[s] + by
        there[s] = (later >= t[0]) & (later <= t[-1]) & (len(t) > 1)
        if len(t) > 1:
            curve = scipy.interpolate.CubicSpline(t, columns[s][first])
            found[s] = curve(np.clip(later, t[0], t[-1]))
    return found, there


def basis_of(X: Array) -> Array:
    """Orthonormal columns (k, p) of the directions of columns that differ."""
    X = X[:, np.abs(X).max(axis=0) > 0.0]
    basis, sizes, _ = np.linalg.svd(X / np.linalg.norm(X, axis=0), full_matrices=False)
    return np.asarray(basis[:, sizes > 1e-6 * sizes[0]])


def _left(read: Array, X: Array, at: Rows, shifts: Rows) -> Array:
    """Mean squares of what columns so many rows before leave of readings, and how that correlates.

    Returns:
        Both (s, 2), of readings (k,) and orthonormal columns (m, p) of the rows around them.
    """
    found = np.empty((len(shifts), 2))
    for k, (shift, G) in enumerate(zip(shifts, _products(X, at, shifts), strict=True)):
        before = X[at - shift]
        left = read - before @ np.linalg.solve(G, before.T @ read)
        square = max(float(np.mean(left**2)), 1e-300)
        found[k] = square, np.clip(np.mean(left[1:] * left[:-1]) / square, 0.0, 0.99)
    return found


def _products(X: Array, at: Rows, shifts: Rows) -> Array:
    """Products (s, p, p) of the columns so many rows before: from one to the next by their ends."""
    breaks = np.diff(at) > 1
    first, last = at[np.append(True, breaks)], at[np.append(breaks, True)]
    start = X[at - shifts[0]]
    come, gone = X[first - shifts[1:, None]], X[last - shifts[:-1, None]]
    steps = come.swapaxes(1, 2) @ come - gone.swapaxes(1, 2) @ gone
    some = constants.HARDLY * np.eye(X.shape[1])  # what columns no more than touch is left alone
    return np.concatenate([[start.T @ start + some], steps]).cumsum(axis=0)

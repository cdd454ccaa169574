r"""Efforts that passed a filter before they were logged: of first order, with one time for all.

.. math:: T \dot y + y = \tau, \qquad
          \hat\tau = X \hat\theta + r + T\, \dot r, \quad r = y - F_T X \hat\theta

A filter is late by T, and takes of what is fast the more, which a delay does not: taken for one, it
leaves efforts that bodies of less inertia would ask for. So where efforts are late, columns X of
what they should read pass filters :math:`F_T`, and the time is the one that makes the readings the
most probable, as in :mod:`plumbline.optim.recording.late`; there is a filter where that is surely
more probable than the delay alone, whichever joint is not asked. What passed it comes back by the
columns, which know where dry friction turns, and by smoothed derivatives of what these leave
(deconvolution by a model and its innovation: Mendel 1983, Optimal Seismic Deconvolution, ch. 2).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from plumbline.optim.recording import constants
from plumbline.optim.recording.derivatives import half_window, stretches, usual_step
from plumbline.optim.recording.late import (
    Place,
    Rows,
    around,
    basis_of,
    best_place,
    rows_asked,
)
from plumbline.optim.recording.table import Array

Columns = Callable[[Rows, float], Sequence[Array]]


@dataclass(frozen=True, eq=False)
class Channel:
    """A channel of N rows that may have passed a filter."""

    time: Array  # (N,) [s]
    read: Array  # (N, n)
    # of rows (k,) and a time T, what each joint's reading is made of (k, p), as late as the channel
    # is but for T
    columns: Columns

    def filter_time(self) -> float:
        """Time constant of the filter [s]; zero where none is sure."""
        step = usual_step(self.time)
        most = round(constants.LATEST / step)
        rows = self._rows
        if most < 1 or len(rows) < constants.FEWEST_EFFORTS:
            return 0.0

        def place(T: float) -> Place:
            return best_place(self.read, rows, self._designs(T, around(rows, most)), most)

        times = (0.0, *(T for T in constants.FILTERS if step < T))  # a faster one is within a row
        places = [place(T) for T in times]
        found = int(np.argmin([np.log(at.square).sum() for at in places]))
        effective = places[found].effective / 2.0
        gains = effective * np.log(places[0].square / places[found].square)
        if found == 0 or not gains.sum() - gains.max() > constants.SURELY_FILTERED:
            return 0.0
        near = np.linspace(times[found - 1], times[min(found + 1, len(times) - 1)], constants.FINER)
        return _lowest(near, [float(effective @ np.log(place(T).square)) for T in near])

    def off(self, T: float) -> float:
        """How much later than its columns the channel is behind such a filter [s]."""
        step, rows = usual_step(self.time), self._rows
        most = round(constants.LATEST / step)
        return step * best_place(self.read, rows, self._designs(T, around(rows, most)), most).rows

    def before(self, T: float) -> tuple[Array, float]:
        """What was read (N, n) before a filter of time T [s], and how much more noise it has.

        In runs of fewer rows than a window holds that is what the columns tell.
        """
        step, first = usual_step(self.time), self._first
        wanted, theta = np.empty_like(self.read), []
        for X, y in zip(self.columns(first, T), self.read.T, strict=True):
            F = passed(self.time[first], X, T)[self._rows]
            theta.append(np.linalg.lstsq(F, y[self._rows], rcond=1e-6)[0])
        for rows in np.array_split(np.arange(len(wanted)), -(-len(wanted) // len(first))):
            own = zip(self.columns(rows, T), theta, strict=True)
            wanted[rows] = np.column_stack([X @ t for X, t in own])
        rest = self.read - passed(self.time, wanted, T)
        width = 2 * half_window(1.0 / step, len(rest)) + 1
        found = wanted + rest
        for s in (s for s in stretches(self.time, step) if len(s) >= width):
            found[s] += T * scipy.signal.savgol_filter(
                rest[s], width, constants.ORDER, deriv=1, delta=step, axis=0
            )
        taps = scipy.signal.savgol_coeffs(width, constants.ORDER, deriv=1, delta=step)
        return found, float(np.hypot(1.0, T * np.linalg.norm(taps)))

    @property
    def _first(self) -> Rows:
        return np.arange(min(len(self.time), constants.EFFORT_ROWS))

    @property
    def _rows(self) -> Rows:
        """Of these the ones by which a filter has forgotten how a run began."""
        time = self.time[self._first]
        return rows_asked(time, constants.FORGOTTEN * round(constants.LATEST / usual_step(time)))

    def _designs(self, T: float, rows: Rows) -> list[Array]:
        first = self._first
        every = (passed(self.time[first], X, T) for X in self.columns(first, T))
        return [basis_of(X[rows]) for X in every]


def _lowest(at: Array, values: Sequence[float]) -> float:
    """Where values are lowest, by the parabola through some about the least, which places blur."""
    best = int(np.argmin(values))
    some = slice(max(best - 2, 0), best + 3)
    a, b, _ = np.polyfit(at[some], values[some], 2)
    within = at[some][0], at[some][-1]
    return float(np.clip(-b / (2.0 * a), *within)) if a > 0.0 else float(at[best])


def passed(time: Array, X: Array, T: float) -> Array:
    """Columns (N, p) behind the filter, exact for what runs straight from row to row."""
    if not T:
        return X
    step = usual_step(time)
    stays = np.exp(-step / T)
    late = T / step * (1.0 - stays)
    taps = [1.0 - late, late - stays], [1.0, -stays]
    found = np.empty_like(X)
    for s in stretches(time, step):
        begin = X[s[:1]] * late  # as if it had stood there before
        found[s] = scipy.signal.lfilter(*taps, X[s], axis=0, zi=begin)[0]
    return found

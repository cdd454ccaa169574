"""A run on an even clock: what was sent, and smoothed places, speeds and accelerations."""

from __future__ import annotations

import numpy as np
import scipy

from plumbline.optim.diagnosis.motion.constants import CUBIC, POSTURE, QUINTIC
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.windows import Array


def on_even_clock(r: MotionRecording, rows: slice, dt: float, seconds: float) -> tuple[Array, ...]:
    """Time, commands, positions, postures, speeds, accelerations of a run on an even clock.

    And the squares of what a position's noise is of a reading's.
    """
    t = r.time[rows]
    even = np.minimum(np.arange(t[0], t[-1] + dt * 1e-6, dt), t[-1])
    u, q = (_between(t, a[rows], even) for a in (r.command, r.q))
    if r.law.holds:  # what was sent last stands; a millionth of a step is rounding
        u = stood(t, r.command[rows], even, dt)
    moved = derivative(q, dt, 1, seconds), derivative(q, dt, 2, seconds)
    shares = _between(t, np.eye(4)[np.arange(len(t)) % 4], even)  # of four rows about each
    return even, u, q, derivative(q, dt, 0, POSTURE), *moved, np.sum(shares**2, axis=1)


def stood(t: Array, u: Array, even: Array, dt: float) -> Array:
    """What stood (M, n) over each sample of a clock: its mean, where that has fewer than rows."""
    at = np.searchsorted(t, even + dt * 1e-6, side="right") - 1
    if dt < 1.5 * np.median(np.diff(t)):
        return u[at]
    area = np.zeros_like(u)
    np.cumsum(np.diff(t)[:, None] * u[:-1], axis=0, out=area[1:])
    ends = np.append(even, even[-1] + dt)
    low = np.searchsorted(t, ends, side="right") - 1
    return np.diff(area[low] + (ends - t[low])[:, None] * u[low], axis=0) / dt


def _between(t: Array, values: Array, at: Array) -> Array:
    """Rows (N, n) at other times (M,): cubics with slopes of the rows on both sides.

    Straight lines leave ten times an encoder's noise where one row of 50 a second is lost.
    """
    return np.asarray(
        scipy.interpolate.CubicHermiteSpline(t, values, np.gradient(values, t, axis=0))(at)
    )


def derivative(q: Array, dt: float, order: int, seconds: float) -> Array:
    """What polynomials have it be (M, n), by least squares over so long about each sample."""
    width = max(2 * round(seconds / dt / 2) + 1, 5)
    if len(q) < width:
        return np.zeros_like(q) if order else q
    power = CUBIC if order else min(QUINTIC, width - 2)  # speeds would be 2.5 times as noisy
    return np.asarray(scipy.signal.savgol_filter(q, width, power, deriv=order, delta=dt, axis=0))

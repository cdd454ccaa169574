r"""Velocities and accelerations of a recorded motion, by zero-phase smoothing.

.. math:: \hat x(t) = \sum_k c_k\, x(t_k), \qquad f_c \approx
          \frac{(p + 1)\, f_s / 2}{3.2\, M - 4.6}

Least-squares polynomials of order p = 3 over windows of 2 M + 1 samples (Savitzky, Golay 1964); a
symmetric window shifts nothing in time. The window is the one whose bandwidth (-3 dB; Schafer 2011,
IEEE Signal Processing Magazine 28(4), eq. 16) comes nearest to :data:`BANDWIDTH`. It goes by the
clock alone: never by what the fit leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter
from scipy.special import erf

from plumbline.errors import fault
from plumbline.optim.recording.constants import (
    BANDWIDTH,
    GAP_IN_TIME,
    LEAST_WINDOW,
    SURE_SPEED,
    SURELY_TURNING,
)
from plumbline.optim.recording.origin import Array, Origin

ORDER = 3


@dataclass(frozen=True, eq=False)
class Motion:
    """Velocities and accelerations (N, n), and how they were come by.

    Attributes:
        velocity: [rad/s or m/s].
        acceleration: [rad/s^2 or m/s^2].
        note: One line on the smoothing; empty where there was none.
    """

    velocity: Array
    acceleration: Array
    note: str = ""


def derived_motion(
    q: Array,
    velocity: Array | None,
    time: Array | None,
    group: NDArray[np.int64] | None,
    origin: Origin,
) -> Motion:
    """Velocities, smoothed, and accelerations from the same windows.

    Args:
        q: Joint readings (N, n).
        velocity: Joint velocities (N, n); derived from the readings where there are none.
        time: Clock (N,) [s].
        group: Runs, each with a clock of its own (N,).
        origin: Where the rows are from.

    Raises:
        PlumblineError: There is no clock, or a run is too short for a window.
    """
    if time is None:
        expected = "columns acceleration1..n, or time to derive them from"
        raise fault(origin.file, "neither acceleration1 nor time", expected, "add the column time")
    step = _usual_step(time)
    half = half_window(1.0 / step)
    v, a = np.empty_like(q), np.empty_like(q)
    for rows in stretches(time, group, step):
        if len(rows) < 2 * half + 1:
            found = f"a run of {len(rows)} rows up to a gap in time"
            expected = f"at least {2 * half + 1} rows {step:.3g} s apart, to derive accelerations"
            mend = "record acceleration1..n, delete the short run, or number runs in 'group'"
            raise fault(origin.at("time", rows[0]), found, expected, mend)
        source = q[rows] if velocity is None else velocity[rows]
        v[rows], a[rows] = _smoothed(time[rows], source, step, half, from_place=velocity is None)
    width = bandwidth(1.0 / step, half)
    what = "accelerations" if velocity is not None else "velocities and accelerations"
    note = (
        f"{what} derived by zero-phase smoothing: cubics over {2 * half + 1} samples of "
        f"{step:.4g} s, bandwidth {width:.3g} Hz"
    )
    return Motion(v, a, note)


def _usual_step(time: Array) -> float:
    steps = np.diff(time)
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0


def half_window(rate: float) -> int:
    """M of the window whose bandwidth comes nearest to :data:`BANDWIDTH`, at ``rate`` [Hz]."""
    wanted = ((ORDER + 1) * rate / (2.0 * BANDWIDTH) + 4.6) / 3.2
    return max(LEAST_WINDOW, round(wanted))


def bandwidth(rate: float, half: int) -> float:
    """Frequency [Hz] at which a window of 2 M + 1 samples lets half of the power pass."""
    return min((ORDER + 1) * rate / 2.0 / (3.2 * half - 4.6), rate / 2.0)


def stretches(time: Array, group: NDArray[np.int64] | None, step: float) -> list[NDArray[np.intp]]:
    """Rows of each run without a gap in time, in order."""
    runs = np.zeros(len(time), dtype=np.int64) if group is None else group
    found = []
    for run in np.unique(runs):
        rows = np.flatnonzero(runs == run)
        cuts = np.flatnonzero(np.diff(time[rows]) > GAP_IN_TIME * step) + 1
        found += np.split(rows, cuts)
    return found


def _smoothed(
    time: Array, values: Array, step: float, half: int, *, from_place: bool
) -> tuple[Array, Array]:
    """Velocity and acceleration at the given times, from even ones in between."""
    even = np.linspace(time[0], time[-1], max(round((time[-1] - time[0]) / step), 2 * half) + 1)
    delta = float(even[1] - even[0])
    at_even = _at(even, time, values)
    first = 1 if from_place else 0
    parts = [
        savgol_filter(at_even, 2 * half + 1, ORDER, deriv=order, delta=delta, axis=0)
        for order in (first, first + 1)
    ]
    return _at(time, even, parts[0]), _at(time, even, parts[1])


def _at(wanted: Array, time: Array, values: Array) -> Array:
    """Columns (N, n) of values at other times, on straight lines between their own."""
    return np.stack([np.interp(wanted, time, column) for column in values.T], axis=1)


def turning(velocity: Array, noise: Array) -> Array:
    r"""Which way each joint turns (N, n), from -1 to 1: the sign to be expected of its velocity.

    Of a true velocity read with noise :math:`\sigma_v` it is
    :math:`\mathrm{erf}(v / \sqrt 2 \sigma_v)`: near standstill the sign of the reading is noise.

    Args:
        velocity: Velocities (N, n).
        noise: Their noise, joint by joint (n,).
    """
    return np.asarray(erf(velocity / (np.sqrt(2.0) * np.maximum(noise, 1e-12))))


def velocity_noise(raw: Array | None, smooth: Array) -> Array:
    """Noise of the velocities that are used (n,), and no less than a thousandth of the largest.

    What smoothing took away, in the part of it that stays; joints that never move get one.
    """
    fastest = np.abs(smooth).max(axis=0)
    taken = np.zeros(smooth.shape[1]) if raw is None else np.std(raw - smooth, axis=0)
    least = np.where(fastest > 0.0, SURE_SPEED * fastest, 1.0)
    return np.asarray(np.maximum(SURELY_TURNING * taken, least))

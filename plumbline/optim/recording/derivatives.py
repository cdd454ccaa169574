r"""Velocities and accelerations of a recorded motion, by zero-phase smoothing.

.. math:: \hat x(t) = \sum_{|k| \le M} c_k\, x(t + k / f_s), \qquad
          \left|\sum_k c_k e^{2 \pi i k f_c / f_s}\right|^2 = \tfrac12

Least-squares quintics over windows of 2 M + 1 samples (Savitzky, Golay 1964, Analytical Chemistry
36(8)); a symmetric window shifts nothing in time. The window is the one whose bandwidth
:math:`f_c` comes nearest to :data:`BANDWIDTH`. It goes by the clock alone: never by what the fit
leaves.
"""

from bisect import bisect_left
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from scipy.special import erf

from plumbline.errors import PlumblineError, fault, shown
from plumbline.optim.recording import constants
from plumbline.optim.recording.table import Array, Flags, Indices, Origin


@dataclass(frozen=True, eq=False)
class DerivedMotion:
    """Velocities and accelerations (N, n), and how they were come by."""

    velocity: Array  # [rad/s or m/s]
    acceleration: Array  # [rad/s^2 or m/s^2]
    # what noise of the readings is left in both (n,), 1 sigma
    velocity_noise: Array
    acceleration_noise: Array
    note: str = ""  # one line on the smoothing; empty where there was none


def derived_motion(
    q: Array, velocity: Array | None, time: Array | None, origin: Origin
) -> DerivedMotion:
    """Velocities, smoothed, and accelerations from the same windows, of readings (N, n) [rad or m].

    Velocities (N, n) are derived from the readings where there are none; time is (N,) [s].
    """
    if time is None:
        expected = "columns acceleration1..n, or time to derive them from"
        raise fault(origin.file, "neither acceleration1 nor time", expected, "add the column time")
    step = usual_step(time)
    if not np.isfinite(step):
        raise _stands_still(time[0], 0, origin)
    half = half_window(1.0 / step, len(q))
    v, a, square = np.empty_like(q), np.empty_like(q), np.zeros(q.shape[1])
    for rows in stretches(time, step):
        if len(rows) < 2 * half + 1:
            found = f"a run of {len(rows)} rows up to a gap in time"
            expected = f"at least {2 * half + 1} rows {step:.3g} s apart, to derive accelerations"
            mend = "record acceleration1..n, delete the short run, or write acceleration1..n"
            raise fault(origin.at("time", rows[0]), found, expected, mend)
        if time[rows[-1]] <= time[rows[0]]:
            raise _stands_still(time[rows[0]], rows[0], origin)
        source = q[rows] if velocity is None else velocity[rows]
        v[rows], a[rows] = _smoothed(time[rows], source, step, half, from_place=velocity is None)
        left = source - scipy.signal.savgol_filter(source, 2 * half + 1, constants.ORDER, axis=0)
        square += (left**2).sum(axis=0)
    rough, order = np.sqrt(square / len(q)), 2 if velocity is None else 1
    slow, fast = (rough * noise_gain(step, half, k) for k in (order - 1, order))
    width = bandwidth(1.0 / step, half)
    what = "accelerations" if velocity is not None else "velocities and accelerations"
    note = (
        f"{what} derived by zero-phase smoothing: quintics over {2 * half + 1} samples of "
        f"{step:.4g} s, bandwidth {width:.3g} Hz"
    )
    return DerivedMotion(v, a, slow, fast, note)


def usual_step(time: Array) -> float:
    """Time from row to row [s]; without end where a clock never goes on."""
    step = np.diff(time)
    return float(np.median(step[step > 0])) if (step > 0).any() else np.inf


def _stands_still(moment: float, row: int, origin: Origin) -> PlumblineError:
    found = f"a clock that stands at {shown(float(moment))} s"
    mend = "mend the clock, or write acceleration1..n"
    return fault(origin.at("time", row), found, "one that goes on", mend)


def half_window(rate: float, rows: int) -> int:
    """M of the window whose bandwidth comes nearest to :data:`BANDWIDTH`, at ``rate`` [Hz].

    No run of so many ``rows`` holds a window of more than half of them: none is looked for.
    """
    longest = max(constants.LEAST_WINDOW + 1, min(int(rate / constants.BANDWIDTH), rows))
    halves = range(constants.LEAST_WINDOW, longest + 1)
    above = bisect_left(halves, -constants.BANDWIDTH, key=lambda half: -bandwidth(rate, half))
    near = halves[max(above - 1, 0) : above + 1]
    return min(near, key=lambda half: abs(bandwidth(rate, half) - constants.BANDWIDTH))


def bandwidth(rate: float, half: int) -> float:
    """Frequency [Hz] at which a window of 2 M + 1 samples lets half of the power pass."""
    taps, k = scipy.signal.savgol_coeffs(2 * half + 1, constants.ORDER), np.arange(-half, half + 1)
    # Below its first zero, near half a turn a window, the response falls all the way.
    share = scipy.optimize.brentq(
        lambda f: (taps @ np.cos(2 * np.pi * f * k)) ** 2 - 0.5, 0.0, 1.0 / half
    )
    return float(share) * rate


def noise_gain(step: float, half: int, order: int) -> float:
    """Noise of a derivative over what smoothing takes away from white readings [1/s^order]."""
    plain = scipy.signal.savgol_coeffs(2 * half + 1, constants.ORDER)
    derivative = scipy.signal.savgol_coeffs(2 * half + 1, constants.ORDER, deriv=order, delta=step)
    return float(np.linalg.norm(derivative) / np.sqrt(1.0 - plain[half]))


def stretches(time: Array, step: float) -> list[Indices]:
    """Rows of each run, in order: up to a gap in time, or to where the clock begins anew.

    Groups are no runs: they may be blocks of one that are left out together.
    """
    steps = np.diff(time)
    cuts = np.flatnonzero((steps > constants.GAP_IN_TIME * step) | (steps < 0.0)) + 1
    return [np.asarray(rows) for rows in np.split(np.arange(len(time)), cuts)]


def elsewhere(places: Array) -> Flags:
    """Rows (N - 1,) after which places (N, n) are as far as no other steps are by far."""
    step = np.abs(np.diff(places, axis=0))
    size = np.max(step / np.maximum(np.quantile(step, constants.USUAL, axis=0), 1e-12), axis=1)
    order = np.sort(size)[::-1][: len(size) // constants.SHORTEST + 2]
    apart = np.flatnonzero(order[:-1] > constants.SPEEDS_UP * order[1:])
    return np.asarray(size >= order[apart[-1]] if len(apart) else np.zeros(len(size), bool))


def _smoothed(
    time: Array, values: Array, step: float, half: int, *, from_place: bool
) -> tuple[Array, Array]:
    """Velocity and acceleration at the given times, from even ones in between."""
    even = np.linspace(time[0], time[-1], max(round((time[-1] - time[0]) / step), 2 * half) + 1)
    delta = float(even[1] - even[0])
    at_even = _at(even, time, values)
    first = 1 if from_place else 0
    filtered = partial(
        scipy.signal.savgol_filter, at_even, 2 * half + 1, constants.ORDER, delta=delta, axis=0
    )
    v, a = (_at(time, even, filtered(deriv=order)) for order in (first, first + 1))
    return v, a


def _at(wanted: Array, time: Array, values: Array) -> Array:
    """Columns (N, n) of values at other times, on straight lines between their own."""
    return np.stack([np.interp(wanted, time, column) for column in values.T], axis=1)


def turning(velocity: Array, noise: Array) -> Array:
    r"""Which way each joint turns (N, n), from -1 to 1: the sign to be expected of its velocity.

    Of a true velocity read with noise :math:`\sigma_v` (n,) it is
    :math:`\mathrm{erf}(v / \sqrt 2 \sigma_v)`: near standstill the sign of the reading is noise.
    """
    return np.asarray(erf(velocity / (np.sqrt(2.0) * np.maximum(noise, 1e-12))))


def velocity_noise(raw: Array | None, smooth: Array, left: Array) -> Array:
    """Noise of the velocities that are used (n,); joints that never move get one.

    What smoothing has left of it (n,); where nothing was smoothed a part of the largest, or what
    third differences of readings show where that is less.
    """
    fastest = np.abs(smooth).max(axis=0)
    least = np.where(fastest > 0.0, constants.SURE_SPEED * fastest, 1.0)
    if raw is not None and len(raw) > 3:
        rough = np.median(np.abs(np.diff(raw, 3, axis=0)), axis=0) / constants.THIRD_DIFFERENCE
        least = np.where(fastest > 0.0, np.minimum(least, rough), least)
    return np.asarray(np.where((left > 0.0) & (fastest > 0.0), left, least))

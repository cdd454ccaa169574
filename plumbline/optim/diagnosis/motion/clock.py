"""A run on an even clock: what was sent, and smoothed places, speeds and accelerations."""

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
    if r.law.holds:  # what was sent last stands
        u = stood(t, r.command[rows], even, dt)
    posture = derivative(q, dt, 0, POSTURE)
    speed, acceleration = (derivative(q, dt, order, seconds) for order in (1, 2))
    if r.law.follows:
        speed = _beyond_noise(speed, u, q - posture, dt, seconds)
    shares = _between(t, np.eye(4)[np.arange(len(t)) % 4], even)  # of four rows about each
    return even, u, q, posture, speed, acceleration, np.sum(shares**2, axis=1)


def stood(t: Array, u: Array, even: Array, dt: float) -> Array:
    """Mean (M, n) of what stood over each sample of a clock: what was sent adds up to the same.

    Not what stood at its beginning: where stamps err by a rounding, that is another row's.
    """
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


def _beyond_noise(speed: Array, u: Array, off: Array, dt: float, seconds: float) -> Array:
    r"""Speeds (M, n) of commands, and what smoothed ones differ by beyond their readings' noise.

    .. math:: \dot u + \max\Bigl(0, 1 - \frac{\sigma_v^2}{\overline{(v - \dot u)^2}}\Bigr)
              (v - \dot u)

    (Efron and Morris 1973, JASA 68:117). A planned way that begins too fast, by the noise of its
    readings, is another for seconds: speed and noise then tell other causes than there are.

    Args:
        speed: As smoothed over so many seconds (M, n) [rad/s].
        u: Commands of place (M, n) [rad].
        off: Readings less what is smoothed of them (M, n) [rad], by which their noise is known.
        dt: Time from sample to sample [s].
        seconds: Over how long speeds are smoothed [s].
    """
    asked = derivative(u, dt, 1, seconds)
    weights, own = _weights(dt, 1, seconds), _weights(dt, 0, POSTURE).max()  # of a reading itself
    noise = np.mean(off**2, axis=0) / (1 - own) * np.sum(weights**2)
    square = np.maximum(np.mean((speed - asked) ** 2, axis=0), 1e-300)
    return np.asarray(asked + np.maximum(1 - noise / square, 0) * (speed - asked))


def derivative(q: Array, dt: float, order: int, seconds: float) -> Array:
    """What polynomials have it be (M, n), by least squares over so long about each sample."""
    width, power = _polynomial(dt, order, seconds)
    if len(q) < width:
        return np.zeros_like(q) if order else q
    return np.asarray(scipy.signal.savgol_filter(q, width, power, deriv=order, delta=dt, axis=0))


def _weights(dt: float, order: int, seconds: float) -> Array:
    """What a sample's place or derivative, as smoothed, has of each reading about it."""
    width, power = _polynomial(dt, order, seconds)
    return np.asarray(scipy.signal.savgol_coeffs(width, power, deriv=order, delta=dt))


def _polynomial(dt: float, order: int, seconds: float) -> tuple[int, int]:
    """Samples and degree: speeds of a quintic would be 2.5 times as noisy."""
    width = max(2 * round(seconds / dt / 2) + 1, 5)
    return width, CUBIC if order else min(QUINTIC, width - 2)


def mean_of_ends(values: Array) -> Array:
    """Over each step (K - 1, ...) of values at its ends (K, ...)."""
    return np.asarray((values[:-1] + values[1:]) / 2)

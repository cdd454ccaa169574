"""What commands do between the rows of a log, where they run smoothly or turn corners there."""

import math

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.diagnosis.motion.constants import RATIO_STEP

Array = NDArray[np.float64]


def share_of_mean(ratio: float) -> tuple[float, float]:
    r"""How far what lags by so many samples takes a step's mean, and not its end; its derivative.

    Commands that run smoothly have over a step the mean of the ends less :math:`\delta^2 / 12`, of
    second differences; a lag of ratio r weighs what they are off a straight line by
    :math:`6 (r - 2 r^2 + (r + 2 r^2)\, e^{-1/r}) / (1 - e^{-1/r})` of that: all for long ones.
    """
    ahead = ratio + RATIO_STEP * (1 + ratio)
    here, there = (_share(r) for r in (ratio, ahead))
    return here, (there - here) / (ahead - ratio)


def _share(r: float) -> float:
    stays, square = math.exp(-1 / (r + 1e-9)), 2 * r**2
    return 6 * (r - square + stays * (r + square)) / (1 - stays)


def bend_of(u: Array, first: NDArray[np.int64]) -> Array:
    """Second differences (N,), none where a run begins or ends."""
    found = np.zeros_like(u)
    found[1:-1] = np.where(first[2:] == first[:-2], u[2:] - 2 * u[1:-1] + u[:-2], 0.0)
    return found


def between(start: Array, slope: Array, bends: list[Array], f: Array) -> Array:
    """A share f of a step on, by its ends and their second differences (Everett's formula)."""
    back, on = ((x**3 - x) / 6 for x in (1 - f, f))
    return np.asarray(start + f * slope + back * bends[0] + on * bends[1])


def between_slope(slope: Array, bends: list[Array], f: Array) -> Array:
    """Its derivative by f."""
    back, on = ((3 * x**2 - 1) / 6 for x in (1 - f, f))
    return np.asarray(slope - back * bends[0] + on * bends[1])

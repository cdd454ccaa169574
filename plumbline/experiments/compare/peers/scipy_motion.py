"""Offset, delay and lag of every joint by SciPy: a filter in NumPy, finite differences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter

Array = NDArray[np.float64]


def version() -> str:
    """Of SciPy."""
    return str(scipy.__version__)


def misses(x: Array, given: Mapping[str, Array], joint: int, starts: Array) -> Array:
    """Predicted minus measured (W, K) [rad]: a lag is exact for commands that run straight."""
    offset, delay, lag = x
    dt, length, settle = float(given["dt"]), int(given["length"]), int(given["settle"])
    u, q = given["u"][:, joint], given["q"][:, joint]
    at = starts[:, None] + np.arange(length + 1)
    c = np.interp(at - delay / dt, np.arange(len(u)), u) + offset
    ratio = lag / dt
    stays = np.exp(-1 / (ratio + 1e-9))
    late = ratio * (1 - stays)
    drive = (1 - late) * c[:, 1:] + (late - stays) * c[:, :-1]
    begin = stays * q[starts][:, None]
    out = lfilter([1.0], [1.0, -stays], drive, axis=1, zi=begin)[0]
    return np.asarray((out - q[at[:, 1:]])[:, settle:])


def _flat(x: Array, given: Mapping[str, Array], joint: int, starts: Array) -> Array:
    return misses(x, given, joint, starts).ravel()


def fit(given: Mapping[str, Array]) -> Any:
    """Offset, delay and lag (n, 3)."""
    lower, upper = np.array([-0.5, 0.0, 0.0]), np.array([0.5, 0.25, 0.5])
    found = []
    for j in range(given["q"].shape[1]):
        more = (given, j, given["fit"])
        solved = least_squares(
            _flat, given["start"], args=more, bounds=(lower, upper), x_scale=(0.05, 0.03, 0.03)
        )
        found.append(solved.x)
    return found


def figures(given: Mapping[str, Array], found: Any) -> dict[str, float]:
    """RMS on windows not fitted [mrad]."""
    squares = [np.mean(misses(x, given, j, given["judge"]) ** 2) for j, x in enumerate(found)]
    return {"error": 1e3 * float(np.sqrt(np.mean(squares)))}

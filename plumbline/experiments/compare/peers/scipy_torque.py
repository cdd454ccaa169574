"""The same five terms a joint by SciPy: finite differences on torques that Pinocchio gave."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]


def version() -> str:
    """Of SciPy."""
    return str(scipy.__version__)


def torque(x: Array, given: Mapping[str, Array], end: str) -> Array:
    """Efforts (N, n) [N m]."""
    dry, viscous, rotor, scale, zero = x.reshape(5, -1)
    v, a = given[f"v{end}"], given[f"a{end}"]
    whole = given[f"rigid{end}"] + dry * np.sign(v) + viscous * v + rotor * a
    return np.asarray((1 + scale) * whole + zero)


def fit(given: Mapping[str, Array]) -> Array:
    """All parameters."""
    n = given["q"].shape[1]
    lower = np.concatenate([np.zeros(3 * n), np.full(n, -0.9), np.full(n, -np.inf)])

    def residuals(x: Array) -> Array:
        return (torque(x, given, "") - given["tau"]).ravel()

    start = np.maximum(np.zeros(5 * n), lower + 1e-3)
    found = least_squares(residuals, start, bounds=(lower, np.inf), x_scale="jac", max_nfev=200)
    return np.asarray(found.x)


def figures(given: Mapping[str, Array], found: Array) -> dict[str, float]:
    """RMS of the efforts on rows not fitted [N m]."""
    misses = torque(found, given, "_new") - given["tau_new"]
    return {"error": float(np.sqrt(np.mean(misses**2)))}

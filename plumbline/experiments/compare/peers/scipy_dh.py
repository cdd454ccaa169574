"""The link fit as one would type it: DH rows in NumPy, SciPy with finite differences."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def version() -> str:
    """Of SciPy."""
    return str(scipy.__version__)


def tips(x: Array, q: Array) -> Array:
    """Tips (N, 3) [m] of rows (n, 4), tool (3,), frame's place and turn (6,)."""
    n = q.shape[1]
    d, a, alpha, theta = x[: 4 * n].reshape(n, 4).T
    p = np.broadcast_to(x[4 * n : 4 * n + 3], (len(q), 3))
    for j in reversed(range(n)):
        c, s = np.cos(q[:, j] + theta[j]), np.sin(q[:, j] + theta[j])
        ca, sa = np.cos(alpha[j]), np.sin(alpha[j])
        y, z = ca * p[:, 1] - sa * p[:, 2], sa * p[:, 1] + ca * p[:, 2] + d[j]
        r = p[:, 0] + a[j]
        p = np.column_stack([c * r - s * y, s * r + c * y, z])
    place, turn = x[-6:-3], Rotation.from_rotvec(x[-3:]).as_matrix()
    return np.asarray(p @ turn.T + place)


def fit(given: Mapping[str, Array]) -> Array:
    """All parameters."""
    frame = given["frame"]
    turn = Rotation.from_matrix(frame[:3, :3]).as_rotvec()
    start = np.concatenate([given["dh"].ravel(), given["tool"], frame[:3, 3], turn])

    def residuals(x: Array) -> Array:
        return (tips(x, given["q"]) - given["tips"]).ravel()

    return np.asarray(least_squares(residuals, start, x_scale="jac", max_nfev=100).x)


def figures(given: Mapping[str, Array], found: Array) -> dict[str, float]:
    """RMS on rows not fitted [mm]."""
    misses = np.linalg.norm(tips(found, given["q_new"]) - given["tips_new"], axis=1)
    return {"error": 1e3 * float(np.sqrt(np.mean(misses**2)))}

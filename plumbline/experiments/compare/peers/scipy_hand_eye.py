"""Frame and tool by SciPy's trust region with finite differences, from Park's idea of a start."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
LEVER = 0.1  # [m] that a radian weighs as much as


def version() -> str:
    """Of SciPy."""
    return str(scipy.__version__)


def fit(given: Mapping[str, Array]) -> Array:
    """The tool in the flange ``T`` (M, 4, 4) [m] of M set-ups."""
    return np.array([_one(f, s) for f, s in zip(given["flange"], given["seen"], strict=True)])


def _one(flange: Array, seen: Array) -> Array:
    def residuals(x: Array) -> Array:
        frame, tool = _placed(x[:6]), _placed(x[6:])
        apart = np.linalg.inv(seen) @ (frame @ flange @ tool)
        turn = Rotation.from_matrix(apart[:, :3, :3]).as_rotvec()
        return np.concatenate([apart[:, :3, 3].ravel(), LEVER * turn.ravel()])

    start = np.concatenate([_vector(seen[0] @ np.linalg.inv(flange[0])), np.zeros(6)])
    return _placed(least_squares(residuals, start, x_scale="jac", xtol=1e-12, ftol=1e-12).x[6:])


def _placed(x: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(x[3:]).as_matrix(), x[:3]
    return T


def _vector(T: Array) -> Array:
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec()])


def figures(given: Mapping[str, Array], found: Array) -> dict[str, float]:
    """Mean error of the tool's place [mm] and of its turn [mrad]."""
    apart = np.linalg.inv(given["tool"]) @ found
    angle = np.arccos(np.clip((np.trace(apart[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    place = np.linalg.norm(apart[:, :3, 3], axis=1)
    return {"error": 1e3 * float(place.mean()), "turn": 1e3 * float(angle.mean())}

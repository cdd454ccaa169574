r"""Two clouds of points or of rotations, alike but for a rigid motion: how far apart are they?

A rigid frame changes no distance and no angle between rows, so whatever the device's frame is, the
measured tips must be the predicted ones after some rotation and shift (Umeyama 1991).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array

SAMPLE = 500  # rows that are enough to tell units


def some_of(rows: int) -> NDArray[np.int64]:
    """Indices of rows spread evenly over the recording."""
    return np.unique(np.linspace(0, rows - 1, min(rows, SAMPLE)).astype(np.int64))


def spread(points: Array) -> float:
    """Median distance from the median point [m]: a few gross errors do not move it."""
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def misfit(source: Array, target: Array) -> float:
    """Median distance [m] of points (N, 3) after the best rigid match (Umeyama 1991)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    return misfit_about_origin(a, b)


def misfit_about_origin(source: Array, target: Array) -> float:
    """Median distance of vectors (N, 3) after the best rotation."""
    R = best_rotation(source, target)
    return float(np.median(np.linalg.norm(target - source @ R.T, axis=1)))


def best_rotation(source: Array, target: Array) -> Array:
    """The rotation (3, 3) that carries vectors (N, 3) best onto others (Umeyama 1991, eq. 40)."""
    U, _, Vt = np.linalg.svd(target.T @ source)
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt)


def rotations(quaternions: Array) -> Array:
    """Rotation matrices (N, 3, 3) of unit quaternions (N, 4), w first."""
    w, v = quaternions[:, 0], quaternions[:, 1:]
    cross = np.cross(np.eye(3)[None], v[:, None])  # row k: e_k x v, transposed skew of -v
    outer = v[:, :, None] * v[:, None, :]
    scale = (w * w - np.sum(v * v, axis=1))[:, None, None]
    return scale * np.eye(3) + 2.0 * outer + 2.0 * w[:, None, None] * cross

r"""The rigid motion that carries one cloud of points nearest to another, and what it leaves.

A rigid frame changes no distance and no angle between rows, so whatever the device's frame is, the
measured tips must be the predicted ones after some rotation and shift: the rotation nearest to
:math:`\sum_i (q_i - \bar q)(p_i - \bar p)^T` (Arun 1987; Umeyama 1991).
"""

import numpy as np

from plumbline.kinematics.frames import homogeneous
from plumbline.optim.core.constants import SAMPLE
from plumbline.optim.core.problem import Array, Integers


def some_of(rows: int, most: int = SAMPLE) -> Integers:
    """Indices of so many rows at most, spread evenly over all."""
    return np.unique(np.linspace(0, rows - 1, min(rows, most)).astype(np.int64))


def spread(points: Array) -> float:
    """Median distance from the median point [m]: a few gross errors do not move it."""
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def misfit(source: Array, target: Array) -> float:
    """Median distance [m] of points (N, 3) after the best rigid match."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    return float(np.median(np.linalg.norm(b - a @ best_rotation(a, b).T, axis=1)))


def rigid_match(source: Array, target: Array, *, scale: bool = False) -> Array:
    r"""``T_target_source`` (..., 4, 4) that carries points (..., n, 3) nearest to others [m].

    .. math:: \min_{R, t, s} \sum_i |q_i - s R p_i - t|^2

    Arun, Huang and Blostein (1987), IEEE PAMI 9(5); the sign and the scale by Umeyama (1991), IEEE
    PAMI 13(4), eqs. 40-43; with a scale the upper left block is s R. SciPy's
    ``Rotation.align_vectors`` finds the same within 1e-12 (2e-12 on clouds 1e4 times as long as
    wide), but one at a time, in twice the time, and without shift or scale.
    """
    p, q = source.mean(axis=-2), target.mean(axis=-2)
    a, b = source - p[..., None, :], target - q[..., None, :]
    R, size = _procrustes(np.swapaxes(b, -1, -2) @ a)
    if scale:
        R *= (size / np.sum(a * a, axis=(-2, -1)))[..., None, None]
    return homogeneous(R, q - (R @ p[..., None])[..., 0])


def basis(normal: Array) -> Array:
    """A rotation (3, 3) whose third column is a unit normal (3,)."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first), normal])


def best_rotation(source: Array, target: Array) -> Array:
    """The rotation (..., 3, 3) that carries vectors (..., n, 3) nearest to others."""
    return nearest_rotation(np.swapaxes(target, -1, -2) @ source)


def nearest_rotation(M: Array) -> Array:
    r"""The rotations (..., 3, 3) that maximise :math:`\mathrm{tr}(R^T M)`."""
    return _procrustes(M)[0]


def _procrustes(M: Array) -> tuple[Array, Array]:
    r"""Nearest rotations (..., 3, 3) of M, and :math:`\mathrm{tr}(R^T M)` (...)."""
    U, S, Vt = np.linalg.svd(M)
    sign = np.linalg.det(U @ Vt)  # 1, or -1 for a mirror image
    U[..., :, 2] *= sign[..., None]
    return U @ Vt, S[..., 0] + S[..., 1] + sign * S[..., 2]


def rotations(quaternions: Array) -> Array:
    """Rotation matrices (N, 3, 3) of unit quaternions (N, 4), w first."""
    w, v = quaternions[:, 0], quaternions[:, 1:]
    cross = np.cross(np.eye(3)[None], v[:, None])  # row k: e_k x v, transposed skew of -v
    outer = v[:, :, None] * v[:, None, :]
    scale = (w * w - np.sum(v * v, axis=1))[:, None, None]
    return scale * np.eye(3) + 2.0 * outer + 2.0 * w[:, None, None] * cross

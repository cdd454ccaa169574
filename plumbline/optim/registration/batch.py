r"""Kabsch's rotation of many noisy draws at once, by one stacked SVD."""

from __future__ import annotations

import numpy as np

from plumbline.optim.core.problem import Array


def kabsch_batch(ct: Array, robot: Array, *, scale: bool = False) -> Array:
    r"""``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], by least squares.

    .. math:: R = U\, \mathrm{diag}(1, 1, |U V^T|)\, V^T, \quad
              U S V^T = \sum_i (q_i - \bar q)(p_i - \bar p)^T

    Kabsch (1976), Acta Cryst. A32; the sign and the scale by Umeyama (1991), IEEE PAMI 13(4),
    eqs. 40-43. With ``scale`` the upper left block is the rotation times the scale.
    """
    p, q = ct.mean(axis=-2), robot.mean(axis=-2)
    a, b = ct - p[..., None, :], robot - q[..., None, :]
    U, S, Vt = np.linalg.svd(np.swapaxes(b, -1, -2) @ a)
    sign = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    U[..., :, 2] *= sign[..., None]
    R = U @ Vt
    if scale:
        size = (S[..., 0] + S[..., 1] + sign * S[..., 2]) / np.sum(a * a, axis=(-2, -1))
        R *= size[..., None, None]
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = q - np.einsum("...ij,...j->...i", R, p)
    T[..., 3, 3] = 1.0
    return T

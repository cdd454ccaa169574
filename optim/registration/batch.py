r"""Many noisy triples at once: the frame of three markers, and Kabsch's rotation beside it.

.. math:: R_{RC} = \sum_k e_k^R (e_k^C)^T

The three-point frame is written out by coordinates, each an array over the triples, in chunks that
stay in the cache; the symbolic statement of :mod:`optim.registration.three_point` is its test.
"""

from __future__ import annotations

import numpy as np

from optim.problem import Array

CHUNK = 2048  # triples: about thirty arrays of this length fit a cache of half a megabyte


def three_point_batch(ct: Array, robot: Array) -> Array:
    """``T_RC`` (..., 4, 4) of triples (..., 3, 3), one row a marker [m].

    A triple on one line gives NaN, not an error: a few of many draws may be degenerate.
    """
    shape = np.broadcast_shapes(ct.shape, robot.shape)
    c = np.broadcast_to(ct, shape).reshape(-1, 3, 3)
    r = np.broadcast_to(robot, shape).reshape(-1, 3, 3)
    T = np.empty((len(c), 4, 4))
    with np.errstate(divide="ignore", invalid="ignore"):
        for start in range(0, len(c), CHUNK):
            part = slice(start, start + CHUNK)
            _fill(T[part], c[part], r[part])
    return T.reshape(*shape[:-2], 4, 4)


def _fill(T: Array, ct: Array, robot: Array) -> None:
    """Write ``T_RC`` of one chunk (n, 3, 3) into T (n, 4, 4)."""
    c, r = (
        np.ascontiguousarray(ct.transpose(1, 2, 0)),
        np.ascontiguousarray(robot.transpose(1, 2, 0)),
    )
    C, R = _axes(c), _axes(r)
    for i in range(3):
        row = np.multiply(C[0], R[0][i])
        row += C[1] * R[1][i]
        row += C[2] * R[2][i]
        T[:, i, :3] = row.T
        T[:, i, 3] = r[0, i] - (row * c[0]).sum(axis=0)
    T[:, 3] = (0.0, 0.0, 0.0, 1.0)


def _axes(points: Array) -> tuple[Array, Array, Array]:
    """``e1, e2, e3`` (3, n) of three markers (3, 3, n): marker, coordinate, triple."""
    e1, side = points[1] - points[0], points[2] - points[0]
    e1 /= np.sqrt(_dot(e1, e1))
    e3 = _cross(e1, side)
    e3 /= np.sqrt(_dot(e3, e3))
    return e1, _cross(e3, e1), e3


def _dot(a: Array, b: Array) -> Array:
    product: Array = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def _cross(a: Array, b: Array) -> Array:
    """Cross products of (3, n) and (3, n)."""
    out = np.empty_like(a)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[i] = a[j] * b[k] - a[k] * b[j]
    return out


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

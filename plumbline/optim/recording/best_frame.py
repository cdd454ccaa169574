r"""The frame that carries predicted tips onto measured ones, and the tool where it is free.

What is left are the gaps after the best frame F, shift t and, where it is free, tool d, all by
squares,

.. math:: \min_{F, t, d} \sum_i |F\,(p_i + R_i d) + t - y_i|^2
"""

import numpy as np

from plumbline.optim.recording.constants import FRAME_STEPS, HARDLY_TOLD
from plumbline.optim.recording.table import Array
from plumbline.optim.rigid import best_rotation

UNIT_CROSSES = np.cross(np.eye(3)[None], np.eye(3)[:, None]).reshape(3, 9)


def matched(R: Array, p: Array, measured: Array, fit_tool: bool) -> tuple[Array, Array]:
    """The best frame's rotation (..., 3, 3), and measured minus predicted (..., N, 3) in it [m].

    R (..., N, 3, 3) and p (..., N, 3) [m] are the tips' as predicted, by as many set-ups as may be,
    or in as many windows of rows, each as measured (N, 3) or (..., N, 3); ``fit_tool`` frees the
    tool.
    """
    a, y = p - p.mean(axis=-2, keepdims=True), measured - measured.mean(axis=-2, keepdims=True)
    inner, tool = R - R.mean(axis=-3, keepdims=True), np.zeros((*p.shape[:-2], 1, 3, 1))
    F, v = best_rotation(a, y), a
    for _ in range(FRAME_STEPS if fit_tool else 0):
        J = np.concatenate([-cross(v), inner], axis=-1)
        tool = tool + least(J, y @ F - v)[..., None, 3:, None]
        v = a + (inner @ tool)[..., 0]
        F = best_rotation(v, y)
    return F, y - v @ np.swapaxes(F, -1, -2)


def least(J: Array, gaps: Array) -> Array:
    """Unknowns (..., k) that make gaps (..., N, 3) least by their columns (..., N, 3, k)."""
    J = J.reshape(*J.shape[:-3], -1, J.shape[-1])
    J_T = np.swapaxes(J, -1, -2)
    values, vectors = np.linalg.eigh(J_T @ J)
    told = values > HARDLY_TOLD**2 * values[..., -1:]
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=told)
    turned = np.swapaxes(vectors, -1, -2) @ (J_T @ gaps.reshape(*J.shape[:-1], 1))
    return np.asarray((vectors @ (inverse[..., None] * turned))[..., 0])


def cross(v: Array) -> Array:
    """Matrices (..., 3, 3) that take the cross products of vectors (..., 3) with another."""
    return np.asarray(v @ UNIT_CROSSES).reshape(*v.shape, 3)

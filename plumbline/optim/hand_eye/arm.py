r"""Smooth errors of the arm over its poses: a Gaussian process, cut to its leading waves.

Links of other lengths and joints of other zeros than the model's displace the flange by a field
that varies over the workspace as slowly as the poses do. Across board k, with unit normal n,

.. math:: \mathrm{cov}(e_i, e_j) = s^2\, n_i^T n_j
          \exp\!\Big(-\frac{|t_i - t_j|^2}{2 l_t^2} - \frac{|R_i - R_j|_F^2}{4 l_R^2}\Big)

(for small turns by an angle, the squared norm is twice its square). Readings from like poses
thus share an error that no number of them averages out. Shift and tilt of each board are projected
out, and what is left is cut to its leading eigenvectors, as :mod:`plumbline.optim.hand_eye.bow`
does.

Besides, an arm may err in proportion to the beam's own equations: its last joints displace the
flange as another r would, which no reading shows and no smooth field of small reach contains. So
the five columns of r and v, each over its span on a plane, are shapes of the same variance.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import eigsh

from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.constants import ARM_SHIFT, ARM_TURN, READINGS_A_SHAPE
from plumbline.optim.hand_eye.readings import Readings
from plumbline.optim.hand_eye.rows import Frames, marks_of_planes

LEAST_SPAN = 1e-9  # of a column [1 or m]: below, no reading has it


def arm_shapes(readings: Readings, frames: Frames, points: Array, count: int) -> Array:
    """Values of the leading shapes at the readings, and of the beam's own (N, count + 5).

    Args:
        readings: N readings of K planes.
        frames: The planes' frames.
        points: The rebuilt points (N, 3) in the base frame [m].
        count: How many shapes; fewer where there are few readings.
    """
    count = min(count, len(readings) // READINGS_A_SHAPE)
    if not count:
        return np.empty((len(readings), 0))
    return np.hstack([_field(readings, frames, points, count), _as_the_beam(readings, frames)])


def _field(readings: Readings, frames: Frames, points: Array, count: int) -> Array:
    """The leading shapes of the field (N, count)."""
    index = frames.index(readings)
    normals = frames.B[index, :, 2]
    gap = _squared(readings.t) / ARM_SHIFT**2 + _squared(readings.R.reshape(-1, 9)) / (
        2.0 * ARM_TURN**2
    )
    kernel = (normals @ normals.T) * np.exp(-gap / 2.0)
    own = marks_of_planes(index, len(frames.c))
    places = np.einsum("nji,nj->ni", frames.B[index], points - frames.c[index])[:, :2]
    flat = np.hstack([own, own * places[:, :1], own * places[:, 1:]])
    Q, _ = np.linalg.qr(flat)
    free = kernel - Q @ (Q.T @ kernel)
    free -= (free @ Q) @ Q.T
    values, vectors = eigsh(free, k=count, v0=np.ones(len(free)))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _as_the_beam(readings: Readings, frames: Frames) -> Array:
    """The beam's own columns (N, 5), each over its largest span on a plane."""
    u = frames.carried(readings)[0][:, 2, :]
    columns = np.hstack([u, readings.distance[:, None] * u[:, :2]])
    index = frames.index(readings)
    rows = [index == k for k in range(len(frames.c))]
    spans = np.max([np.ptp(columns[own], axis=0) for own in rows], axis=0)
    for own in rows:
        columns[own] -= columns[own].mean(axis=0)  # which the plane's own offset takes up
    return np.asarray(columns / np.maximum(spans, LEAST_SPAN))


def _squared(x: Array) -> Array:
    """Squared distances (N, N) between rows (N, m)."""
    sizes = np.sum(x**2, axis=1)
    return np.asarray(np.maximum(sizes[:, None] + sizes - 2.0 * x @ x.T, 0.0))

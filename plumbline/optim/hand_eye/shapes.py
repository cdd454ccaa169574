r"""Smooth errors of boards and of the arm: Gaussian processes, cut to their leading waves.

A board that is not flat, and across board k, with unit normal n, an arm whose links and zeros are
not its model's, which displaces the flange by a field as slow as its poses:

.. math:: \kappa(x, y) = \exp\!\big(-|x - y|^2 / 2 l^2\big), \qquad
          \mathrm{cov}(e_i, e_j) = s^2\, n_i^T n_j
          \exp\!\Big(-\frac{|t_i - t_j|^2}{2 l_t^2} - \frac{|R_i - R_j|_F^2}{4 l_R^2}\Big)

(for small turns by an angle, the squared norm is twice its square). Shift and tilt of each board
are projected out, being the plane's own. With the eigenvectors u and eigenvalues :math:`\lambda` of
what is left, :math:`h = \sum_m c_m \phi_m`, :math:`\phi_m = \sqrt{\lambda_m} u_m` and
:math:`c_m \sim N(0, s^2)` (Rasmussen and Williams 2006, section 2.7).

Besides, an arm may err in proportion to the beam's own equations: its last joints displace the
flange as another r would, which no reading shows and no smooth field of small reach contains. So
the five columns of r and v, each over its span on a plane, are shapes of the same variance.
"""

import numpy as np
import scipy

from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye import constants
from plumbline.optim.hand_eye.readings import Frames, Readings, marks_of_planes


def shapes(readings: Readings, frames: Frames, points: Array, count: int) -> Array:
    """Leading shapes of each board at N readings (N, count), of rebuilt points (N, 3) [m]."""
    found = np.zeros((len(readings), count))
    index = frames.index(readings)
    for k in range(len(frames.c)):
        rows = index == k
        places = (points[rows] - frames.c[k]) @ frames.B[k][:, :2]
        if len(places) >= constants.LEAST_BOWED:
            own = _shapes(places, count)
            found[np.flatnonzero(rows)[:, None], np.arange(own.shape[1])] = own
    return found


def _shapes(places: Array, count: int) -> Array:
    """Shapes of one board at places (N, 2) on it [m]."""
    squared = np.sum((places[:, None] - places[None]) ** 2, axis=2)
    reach = constants.BOARD_REACH * float(np.sqrt(np.percentile(squared, constants.BOARD_PERCENT)))
    reach = max(reach, constants.LEAST_BOARD)
    kernel = np.exp(-squared / (2.0 * reach**2))
    plane = np.column_stack([np.ones(len(places)), places / reach])
    Q, _ = np.linalg.qr(plane)
    free = np.eye(len(places)) - Q @ Q.T
    values, vectors = np.linalg.eigh(free @ kernel @ free)
    leading = np.argsort(values)[::-1][:count]
    return np.asarray(vectors[:, leading] * np.sqrt(np.maximum(values[leading], 0.0)))


def arm_shapes(readings: Readings, frames: Frames, points: Array, count: int) -> Array:
    """The arm's leading shapes at N readings, and the beam's own (N, count + 5)."""
    count = min(count, len(readings) // constants.READINGS_A_SHAPE)
    if not count:
        return np.empty((len(readings), 0))
    return np.hstack([_field(readings, frames, points, count), _as_the_beam(readings, frames)])


def _field(readings: Readings, frames: Frames, points: Array, count: int) -> Array:
    """The leading shapes of the field (N, count)."""
    index = frames.index(readings)
    normals = frames.B[index, :, 2]
    gap = _squared(readings.t) / constants.ARM_SHIFT**2 + _squared(readings.R.reshape(-1, 9)) / (
        2.0 * constants.ARM_TURN**2
    )
    kernel = (normals @ normals.T) * np.exp(-gap / 2.0)
    own = marks_of_planes(index, len(frames.c))
    places = np.einsum("nji,nj->ni", frames.B[index], points - frames.c[index])[:, :2]
    flat = np.hstack([own, own * places[:, :1], own * places[:, 1:]])
    Q, _ = np.linalg.qr(flat)
    free = kernel - Q @ (Q.T @ kernel)
    free -= (free @ Q) @ Q.T
    values, vectors = scipy.sparse.linalg.eigsh(free, k=count, v0=np.ones(len(free)))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _as_the_beam(readings: Readings, frames: Frames) -> Array:
    """The beam's own columns (N, 5), each over its largest span on a plane."""
    u = frames.carried(readings).R[:, 2, :]
    columns = np.hstack([u, readings.distance[:, None] * u[:, :2]])
    index = frames.index(readings)
    rows = [index == k for k in range(len(frames.c))]
    spans = np.max([np.ptp(columns[own], axis=0) for own in rows], axis=0)
    for own in rows:
        columns[own] -= columns[own].mean(axis=0)  # which the plane's own offset takes up
    return np.asarray(columns / np.maximum(spans, constants.LEAST_SPAN))


def _squared(x: Array) -> Array:
    """Squared distances (N, N) between rows (N, m)."""
    sizes = np.sum(x**2, axis=1)
    return np.asarray(np.maximum(sizes[:, None] + sizes - 2.0 * x @ x.T, 0.0))

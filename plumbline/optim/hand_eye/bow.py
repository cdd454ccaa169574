r"""Smooth shapes of an unflat board: a Gaussian process over it, cut to its leading waves.

.. math:: h \sim N(0, s^2 \kappa), \qquad \kappa(x, y) = \exp\!\big(-|x - y|^2 / 2 l^2\big)

Shift and tilt are projected out, being the plane's own. With the eigenvectors u and eigenvalues
:math:`\lambda` of what is left, :math:`h = \sum_m c_m \phi_m`, :math:`\phi_m = \sqrt{\lambda_m}
u_m` and :math:`c_m \sim N(0, s^2)`: distances alone enter, so the frame on the board is no matter
(Rasmussen and Williams 2006, section 2.7).
"""

from __future__ import annotations

import numpy as np

from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.constants import BOARD_REACH, LEAST_BOWED
from plumbline.optim.hand_eye.readings import Readings
from plumbline.optim.hand_eye.rows import Frames


def shapes(readings: Readings, frames: Frames, points: Array, count: int) -> Array:
    """Values of the leading shapes at the readings (N, count).

    Args:
        readings: N readings of K planes.
        frames: The planes' frames.
        points: The rebuilt points (N, 3) in the base frame [m].
        count: How many shapes a plane has.
    """
    found = np.zeros((len(readings), count))
    index = frames.index(readings)
    for k in range(len(frames.c)):
        rows = index == k
        places = (points[rows] - frames.c[k]) @ frames.B[k][:, :2]
        if len(places) >= LEAST_BOWED:
            own = _shapes(places, count)
            found[np.flatnonzero(rows)[:, None], np.arange(own.shape[1])] = own
    return found


def _shapes(places: Array, count: int) -> Array:
    """Shapes of one board at places (N, 2) on it [m]."""
    squared = np.sum((places[:, None] - places[None]) ** 2, axis=2)
    # From the middle half's spread: a gross reading's place must not stretch the board.
    reach = BOARD_REACH * float(np.sqrt(np.percentile(squared, 98.0)))
    kernel = np.exp(-squared / (2.0 * max(reach, 1e-6) ** 2))
    plane = np.column_stack([np.ones(len(places)), places / max(reach, 1e-6)])
    Q, _ = np.linalg.qr(plane)
    free = np.eye(len(places)) - Q @ Q.T
    values, vectors = np.linalg.eigh(free @ kernel @ free)
    leading = np.argsort(values)[::-1][:count]
    return np.asarray(vectors[:, leading] * np.sqrt(np.maximum(values[leading], 0.0)))

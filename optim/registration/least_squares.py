r"""The rigid fit's minimum by damped Gauss-Newton steps, for one or many draws at once.

.. math:: (J^T J + \mu\, \mathrm{diag}(J^T J))\, x = -J^T r, \qquad
          T \leftarrow \mathrm{move}(T, x)

Every draw has a damping of its own (Madsen, Nielsen, Tingleff 2004, algorithm 3.16); derivatives are
those of the symbolic statement, the start is Kabsch's.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from optim.problem import Array
from optim.registration.batch import kabsch_batch
from optim.registration.markers import Markers
from optim.registration.statement import normal_equations

STEPS = 60
STILL = 1e-12  # [m and rad]: a step that moves nothing
CHUNK = 4096  # draws at a time


def move(T: Array, centre: Array, x: Array) -> Array:
    """Poses (N, 4, 4) displaced by x (N, 6): v [m] at the centre (N, 3), then rotation [rad]."""
    turn = Rotation.from_rotvec(x[:, 3:6]).as_matrix()
    moved = T.copy()
    moved[:, :3, :3] = turn @ T[:, :3, :3]
    arm = T[:, :3, 3] - centre
    moved[:, :3, 3] = centre + x[:, :3] + np.einsum("nij,nj->ni", turn, arm)
    return moved


def minimise(rows: Array) -> tuple[Array, Array]:
    """Minimum (N, 4, 4) of N draws of n markers' rows (N, n, 18), and the squares (N,) there."""
    T, squares = np.empty((len(rows), 4, 4)), np.empty(len(rows))
    for start in range(0, len(rows), CHUNK):
        part = slice(start, start + CHUNK)
        T[part], squares[part] = _minimise(rows[part])
    return T, squares


def _minimise(rows: Array) -> tuple[Array, Array]:
    centre = rows[..., 3:6].mean(axis=1)
    T = kabsch_batch(rows[..., :3], rows[..., 3:6])
    G, g, square = normal_equations(rows, T, centre)
    mu = np.full(len(rows), 1e-9)
    diagonal = np.arange(6)
    for _ in range(STEPS):
        damped = G.copy()
        damped[:, diagonal, diagonal] *= 1 + mu[:, None]
        x = -np.linalg.solve(damped, g[..., None])[..., 0]
        still = np.abs(x).max(axis=1) <= STILL
        if still.all():
            break
        trial = move(T, centre, x)
        G2, g2, square2 = normal_equations(rows, trial, centre)
        better = square2 <= square * (1 + 1e-14)
        T[better], G[better], g[better] = trial[better], G2[better], g2[better]
        square[better] = square2[better]
        mu = np.where(better, np.maximum(mu / 10, 1e-15), mu * 10)
        if (~better & (mu > 1e6)).all():
            break
    return T, square


def best_fit(markers: Markers) -> tuple[Array, float]:
    """The most probable ``T_RC`` (4, 4) and its sum of whitened squares, of 3 n - 6 freedoms."""
    T, squares = minimise(markers.rows[None])
    return T[0], float(squares[0])

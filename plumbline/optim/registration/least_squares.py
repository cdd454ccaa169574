r"""The rigid fit's minimum by damped Newton steps, for one or many draws at once.

.. math:: (H + \mu\, |\mathrm{diag}\, H|)\, x = -g, \qquad T \leftarrow \mathrm{move}(T, x)

Every draw has a damping of its own, and only steps that lower its sum of squares are kept (Madsen,
Nielsen, Tingleff 2004, sec. 2.4). Derivatives are those of the symbolic statement, the start is
Kabsch's fit.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from plumbline.optim.core.judged import Judgement, judged_by_gram
from plumbline.optim.core.mapped import Gram
from plumbline.optim.core.problem import Array
from plumbline.optim.registration.constants import (
    CHUNK,
    HOPELESS,
    LEAST_DAMPING,
    MORE_DAMPING,
    NEARLY,
    NO_WORSE,
    STEPS,
)
from plumbline.optim.registration.markers import Markers
from plumbline.optim.registration.statement import derivatives
from plumbline.optim.rigid import rigid_match


def move(T: Array, centre: Array, x: Array) -> Array:
    """Poses (N, 4, 4) displaced by x (N, 6): v [m] at the centre (N, 3), then rotation [rad]."""
    turn = Rotation.from_rotvec(x[:, 3:6]).as_matrix().astype(np.float64)
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
    """The same for one chunk; draws that have settled leave the work."""
    centre = rows[..., 3:6].mean(axis=1)
    T = rigid_match(rows[..., :3], rows[..., 3:6])
    H, g, square = derivatives(rows, T, centre)
    mu, active = np.zeros(len(rows)), np.arange(len(rows))
    for _ in range(STEPS):
        x = _step(H[active], g[active], mu[active])
        last = np.abs(x).max(axis=1) <= NEARLY
        done = active[last]
        T[done] = move(T[done], centre[done], x[last])
        active, x = active[~last], x[~last]
        if not len(active):
            break
        trial = move(T[active], centre[active], x)
        H2, g2, square2 = derivatives(rows[active], trial, centre[active])
        better = square2 <= square[active] * (1 + NO_WORSE)
        kept = active[better]
        T[kept], H[kept], g[kept] = trial[better], H2[better], g2[better]
        square[kept] = square2[better]
        mu[kept] = np.where(mu[kept] > LEAST_DAMPING, mu[kept] / MORE_DAMPING, 0.0)
        worse = active[~better]
        mu[worse] = np.maximum(MORE_DAMPING * mu[worse], LEAST_DAMPING)
        active = active[mu[active] < HOPELESS]
        if not len(active):
            break
    return T, square


def _step(H: Array, g: Array, mu: Array) -> Array:
    """Damped steps (N, 6); the damping makes up for a Hessian that has no minimum."""
    size = np.abs(np.diagonal(H, axis1=1, axis2=2))
    damped = np.asarray(H + mu[:, None, None] * size[:, :, None] * np.eye(6), dtype=np.float64)
    x = np.linalg.solve(damped, g[..., None])[..., 0]
    return -x.astype(np.float64)


def judged_fit(markers: Markers, T: Array) -> Judgement:
    """Whether ``T_RC`` (4, 4) is a minimum, by the derivatives of the statement there."""
    centre = markers.robot.mean(axis=0)
    H, g, square = derivatives(markers.rows[None], T[None], centre[None])
    about = Gram(H[0], g[0], float(square[0]), 3.0 * len(markers))
    return Judgement.of([judged_by_gram(about, "the fit of the markers")])


@lru_cache(maxsize=16)
def best_fit(markers: Markers) -> tuple[Array, float]:
    """The most probable ``T_RC`` (4, 4) and its sum of whitened squares, of 3 n - 6 freedoms.

    Kept for the same object: a registration asks for it several times.
    """
    T, squares = minimise(markers.rows[None])
    return T[0], float(squares[0])

r"""What joints that give way under weight may have done to the links, unseen.

A weight at :math:`o`, the tip or the middle of all later joints, turns joint j by

.. math:: \delta q_j = \theta\; z_j^T \bigl((o - o_j) \times g\bigr) / (|g|\,L),

L being the reach: a payload, and the arm itself. No link has such an error, yet links make up for a
part of it, which biases them and widens no misfit. So each :math:`\theta` counts as a draw of one
size :math:`\tau`, what it does to the fit adds to its covariance,

.. math:: C \leftarrow C + E[\tau^2]\, M M^T, \qquad M = (J^T A J)^{-1} J^T A\, G,

and the misfits tell of :math:`\tau` by the part that no link makes up for: with u, s the left
singular vectors and values of that part of G, in units of the noise, :math:`u_i^T e` has the
variance :math:`1 + \tau^2 s_i^2`. Before, every order of magnitude of :math:`\tau` is as likely.
"""

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.link_table import LinkTable, row_matrix
from plumbline.optim.core.judged import root_of
from plumbline.optim.core.problem import Array, Indices
from plumbline.optim.dh_fit.constants import LEAST_SOFT, MOST_SOFT, MOST_SOFT_ROWS, RANK, UNSEEN
from plumbline.optim.dh_fit.statement import DHStatement, Pass, Readings
from plumbline.optim.rigid import some_of

SIZES = np.geomspace(LEAST_SOFT, MOST_SOFT, 41)  # [rad]


def softness(
    statement: DHStatement,
    readings: Readings,
    x: Array,
    free: Indices,
    S: Array,
    gravity: Array,
) -> Array:
    """F (free, K) with ``F F^T`` what soft joints add to the covariance, in units of the scales.

    Readings are those not gross, S (3, 3) [m^2] their noise, gravity the base's (3,) [m/s^2].
    """
    none, values = np.zeros((len(free), 0)), np.linalg.eigvalsh(S)
    if not values[0] > 0.0 or not np.linalg.norm(gravity) > 0.0:
        return none
    some = readings.select(some_of(len(readings), MOST_SOFT_ROWS))
    G = turns(statement.links(x), some.q, statement.tips(x, some.q), gravity)
    if not G.shape[2]:
        return none
    parts = list(Pass(statement, some).jacobians(x))
    e, J = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    J = (J * statement.scale)[:, :, free]
    narrow, upper = np.linalg.inv(root_of(S)), root_of(statement.loss.moments(S)[0])
    M = np.linalg.pinv(_flat(upper, J), rcond=RANK) @ _flat(upper, G)
    z: Array = np.asarray(e @ narrow, dtype=float).ravel()
    return np.asarray(M * _size(_flat(narrow, J), _flat(narrow, G), z))


def _flat(W: NDArray[np.floating], columns: NDArray[np.floating]) -> Array:
    return np.asarray((W @ columns).reshape(-1, columns.shape[2]))


def _size(J: Array, G: Array, e: Array) -> float:
    """Root of E[tau^2] [rad], all in units of the noise."""
    Q = np.linalg.qr(J)[0]
    U, s, _ = np.linalg.svd(G - Q @ (Q.T @ G), full_matrices=False)
    seen = s > UNSEEN * max(s.max(initial=0.0), 1e-300)
    z, variance = U[:, seen].T @ e, 1.0 + np.outer(SIZES, s[seen]) ** 2
    log = -0.5 * (np.log(variance) + z**2 / variance).sum(axis=1)
    weight = np.exp(log - log.max())
    return float(np.sqrt(weight @ SIZES**2 / weight.sum()))


def turns(links: LinkTable, q: Array, tips: Array, gravity: Array) -> Array:
    """G (N, 3, K) [m/rad]: what the tips (N, 3) do where a mass turns a joint."""
    axes, origins, turning, _ = joints(links, q)
    points = [*origins, tips]
    reach = float(np.linalg.norm(tips - origins[0], axis=1).max()) or 1.0
    down, columns = gravity / np.linalg.norm(gravity), []
    for j in (j for j, turns_ in enumerate(turning) if turns_):
        moved = np.cross(axes[j], tips - origins[j])
        for point in (tips, np.mean(points[j + 1 :], axis=0)):
            torque = (axes[j] * np.cross(point - origins[j], down)).sum(axis=1) / reach
            columns.append(moved * torque[:, None])
    G = np.stack(columns, axis=2) if columns else np.zeros((len(q), 3, 0))
    return np.asarray(G[:, :, np.abs(G).max(axis=(0, 1)) > UNSEEN])


def joints(links: LinkTable, q: Array) -> tuple[list[Array], list[Array], list[bool], Array]:
    """Axes and origins (N, 3) of every joint in the base, whether it turns; the tip (N, 4, 4)."""
    T = np.tile(np.linalg.inv(links.anchors[0]), (len(q), 1, 1))
    axes, origins, turning, j = [], [], [], 0
    for row in links.rows:
        if row.dh.kind != "fixed":
            axes.append(T[:, :3, 2].copy())
            origins.append(T[:, :3, 3].copy())
            turning.append(row.dh.kind == "revolute")
            T = T @ _motions(row.dh.kind, q[:, j])
            j += 1
        T = T @ row_matrix(row)
    return axes, origins, turning, np.asarray(T @ links.anchors[-1])


def _motions(kind: str, q: Array) -> Array:
    """Placements (N, 4, 4) of a joint's motion."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    if kind == "prismatic":
        T[:, 2, 3] = q
        return T
    T[:, 0, 0] = T[:, 1, 1] = np.cos(q)
    T[:, 1, 0] = np.sin(q)
    T[:, 0, 1] = -T[:, 1, 0]
    return T

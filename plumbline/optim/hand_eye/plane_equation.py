r"""The plane's equation (Zeng et al. 2017, eq. 5) in symbols, and the linear ones made of it.

.. math:: f(R, t, d) = n^T \big(R\,(r + d\,v) + t\big)

up to the plane's offset, which differences of two readings are without. Pure translations t in the
flange's frame change it by (13), over p = n^T v and with m = n / p unknown; turns by (15), with r
unknown; and (14) leaves one equation on v for each orientation:

.. math:: m^T t_j + (d_j - d_0), \qquad n^T v - p, \qquad f(R_j, t_j, d_j) - f(R_0, t_0, d_0)

Each is linear in its unknown x: its value at 0 and its Jacobian are all of it.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.hand_eye.beam import Array


def height(n: cs.SX, r: cs.SX, v: cs.SX, pose: cs.SX) -> cs.SX:
    """f, of a pose's thirteen numbers R (column by column), t [m] and d [m]."""
    R, t, d = cs.reshape(pose[:9], 3, 3), pose[9:12], pose[12]
    return cs.dot(n, R @ (r + d * v) + t)


@lru_cache(maxsize=1)
def translation() -> cs.Function:
    """(t_j - t_0 in the flange's frame, d_j - d_0) -> eq. 13 over p, linear in m."""
    m, row = cs.SX.sym("m", 3), cs.SX.sym("row", 4)
    pose = cs.vertcat(cs.vec(cs.SX.eye(3)), row[:3], 0)
    nothing = cs.SX.zeros(3, 1)
    # The range's own part is d m^T v, and m^T v = 1.
    return _linear(m, row, height(m, nothing, nothing, pose) + row[3])


@lru_cache(maxsize=1)
def component() -> cs.Function:
    """(n, p) -> what eq. 14 leaves for v, linear in v."""
    v, row = cs.SX.sym("v", 3), cs.SX.sym("row", 4)
    return _linear(v, row, cs.dot(row[:3], v) - row[3])


@lru_cache(maxsize=1)
def rotation() -> cs.Function:
    """(n, v, pose and range j, pose and range 0) -> eq. 15, linear in r."""
    r, row = cs.SX.sym("r", 3), cs.SX.sym("row", 32)
    n, v, here, first = row[:3], row[3:6], row[6:19], row[19:]
    return _linear(r, row, height(n, r, v, here) - height(n, r, v, first))


def _linear(x: cs.SX, row: cs.SX, equation: cs.SX) -> cs.Function:
    """An equation linear in x, as row -> (its Jacobian (1, k), its value at x = 0)."""
    value = cs.substitute(equation, x, 0)
    outputs = [cs.densify(cs.jacobian(equation, x)), cs.densify(value)]
    return cs.Function("equation", [row], outputs)


def system(equation: cs.Function, rows: Array) -> tuple[Array, Array]:
    """Matrix (N, 3) and right-hand side (N,) of rows: A x = b in the sense of least squares."""
    matrix, value = over_rows(equation, rows)
    return np.asarray(matrix[:, :, 0]), np.asarray(-value[:, 0, 0])


def poses(R: Array, t: Array, distance: Array) -> Array:
    """Rows (N, 13) of poses (N, 3, 3), (N, 3) [m] and ranges (N,) [m]."""
    return np.hstack([np.swapaxes(R, 1, 2).reshape(-1, 9), t, distance[:, None]])

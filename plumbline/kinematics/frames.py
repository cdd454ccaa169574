r"""Rotations and rigid transforms in CasADi symbols, smooth at the identity.

.. math:: \exp(w) = I + A(\theta) [w]_\times + B(\theta) [w]_\times^2, \quad
          A = \sin\theta / \theta, \quad B = (1 - \cos\theta) / \theta^2

Below :math:`\theta^2 = 10^{-4}` both coefficients are Taylor series in :math:`\theta^2`, so values
and derivatives of every order are finite at zero (Murray, Li, Sastry 1994, eq. 2.14).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.kinematics.constants import ROUNDING, SERIES_BELOW
from plumbline.kinematics.evaluate import Array


def constant(matrix: ArrayLike) -> cs.SX:
    """A numeric matrix as symbols whose rounding-error zeros are structural zeros."""
    values = np.array(matrix, dtype=float)
    return cs.SX(_constant(values.tobytes(), values.shape))


@lru_cache(maxsize=1024)
def _constant(matrix: bytes, shape: tuple[int, ...]) -> cs.SX:
    """The same of what every model of an arm asks for again."""
    values = np.frombuffer(matrix).reshape(shape).copy()
    values[np.abs(values) < ROUNDING] = 0.0
    return cs.SX(cs.sparsify(cs.DM(values)))


def rotation(w: cs.SX) -> cs.SX:
    """Rotation matrix (3, 3) of the rotation vector w (3,) [rad]."""
    return _rotation()(w)


@cache
def _rotation() -> cs.Function:
    """The same as a function: to put symbols into one is far cheaper than to write it out again."""
    w = cs.SX.sym("w", 3)
    angle2 = cs.sumsqr(w)
    small = angle2 < SERIES_BELOW
    safe = cs.sqrt(cs.if_else(small, 1.0, angle2))
    series_a = 1 - angle2 / 6 * (1 - angle2 / 20 * (1 - angle2 / 42 * (1 - angle2 / 72)))
    series_b = 0.5 * (1 - angle2 / 12 * (1 - angle2 / 30 * (1 - angle2 / 56 * (1 - angle2 / 90))))
    a = cs.if_else(small, series_a, cs.sin(safe) / safe)
    b = cs.if_else(small, series_b, 2 * (cs.sin(safe / 2) / safe) ** 2)
    w_hat = cs.skew(w)
    return cs.Function("rotation", [w], [cs.SX.eye(3) + a * w_hat + b * (w_hat @ w_hat)])


def axis_rotation(axis: ArrayLike, angle: cs.SX) -> cs.SX:
    """Rotation matrix (3, 3) about a numeric unit axis (3,) by a symbolic angle [rad]."""
    return _axis_rotation(*np.asarray(axis, dtype=float).tolist())(angle)


@lru_cache(maxsize=64)
def _axis_rotation(x: float, y: float, z: float) -> cs.Function:
    unit, angle = np.array([x, y, z]), cs.SX.sym("angle")
    outer = constant(np.outer(unit, unit))
    hat = constant(np.cross(unit, np.eye(3)).T)
    R = outer + cs.cos(angle) * (cs.SX.eye(3) - outer) + cs.sin(angle) * hat
    return cs.Function("axis_rotation", [angle], [R])


def unskew(matrix: cs.SX) -> cs.SX:
    """Axis times the sine of the angle, (3,), of a rotation matrix (3, 3)."""
    m = matrix
    return cs.vertcat(m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]) / 2


def quaternion_rotation(q: cs.SX) -> cs.SX:
    """Rotation matrix (3, 3) of a unit quaternion (4,), scalar first."""
    w, x, y, z = (q[i] for i in range(4))
    return cs.vertcat(
        cs.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        cs.horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        cs.horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@dataclass(frozen=True)
class Transform:
    """A rigid transform ``T_ab`` in symbols."""

    R: cs.SX  # rotation matrix ``R_ab`` (3, 3)
    t: cs.SX  # translation ``t_ab`` (3,) [m]

    @classmethod
    def identity(cls) -> Transform:
        """The transform that changes nothing."""
        return cls(cs.SX.eye(3), cs.SX(3, 1))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Transform:
        """From a numeric homogeneous matrix (4, 4)."""
        values = np.asarray(matrix, dtype=float)
        return cls(constant(values[:3, :3]), constant(values[:3, 3:]))

    @classmethod
    def from_twist(cls, translation: cs.SX, rotation_vector: cs.SX) -> Transform:
        """From a translation (3,) [m] and a rotation vector (3,) [rad]."""
        return cls(rotation(rotation_vector), translation)

    def __matmul__(self, other: Transform) -> Transform:
        """``T_ab @ T_bc = T_ac``."""
        return Transform(self.R @ other.R, self.R @ other.t + self.t)

    def point(self, p: cs.SX) -> cs.SX:
        """Coordinates in frame a of a point p (3,) [m] given in frame b."""
        return self.R @ p + self.t

    def inverse(self) -> Transform:
        """``T_ba``."""
        return Transform(self.R.T, -(self.R.T @ self.t))


def homogeneous(R: ArrayLike, t: ArrayLike) -> Array:
    """Numeric homogeneous matrices (..., 4, 4) of rotations (..., 3, 3) and places (..., 3) [m]."""
    several = np.shape(R)[:-2]
    T = np.zeros((*several, 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = np.reshape(t, (*several, 3))
    T[..., 3, 3] = 1.0
    return T


def by_columns(rows: Array) -> Array:
    """The same (N, 4, 4) from rows of a rotation by its columns and a place (N, 12)."""
    return homogeneous(rows[:, :9].reshape(-1, 3, 3).transpose(0, 2, 1), rows[:, 9:])

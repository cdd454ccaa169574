r"""The camera's frame from four registration points, in symbols.

With :math:`a_k` a point in camera coordinates and :math:`p_k` the same in robot coordinates, bars
their means,

.. math:: H = \sum_k (p_k - \bar p)(a_k - \bar a)^T, \qquad R = H (H^T H)^{-1/2}, \qquad
          t = \bar p - R \bar a

is the rigid transform that brings the points nearest to each other (Horn, Hilden, Negahdaripour
1988, J. Opt. Soc. Am. A 5(7), sec. 4). Three points that are not on one line fix a rigid transform;
the fourth, off their plane, makes H invertible, so that R is a smooth function of the points. The
published method's own formula is lost; this one is rebuilt.

The polar factor R is found by Newton's iteration (Higham 1986, SIAM J. Sci. Stat. Comput. 7(4)),

.. math:: Y \leftarrow \tfrac12 (\gamma Y + \gamma^{-1} Y^{-T}), \qquad \gamma = |\det Y|^{-1/3},

a fixed number of times. With :math:`S = R^T H` its derivative is known in closed form, from
:math:`S \Omega + \Omega S = R^T dH - dH^T R`:

.. math:: dR = R\,[\omega]_\times, \qquad
          \omega = (\mathrm{tr}(S) I - S)^{-1}\, \mathrm{vee}(R^T dH - dH^T R) .
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.frames import unskew
from plumbline.optim.core.problem import Array
from plumbline.optim.dh_fit.constants import COUNT, FLATTEST, MOST_STEPS, ORTHONORMAL, SPARE_STEPS


def check_points(points: Array) -> None:
    """Refuse registration points that are not four (4, 3) [m], or lie in a plane."""
    if points.shape != (COUNT, 3):
        raise PlumblineError(
            f"registration: {len(points)} points, expected {COUNT}; give {COUNT} rows"
        )
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if not extents[2] > FLATTEST * extents[0]:
        raise PlumblineError(
            f"registration: the points' extents are {extents[2]:.1e} to {extents[0]:.1e} m, ratio "
            f"at least {FLATTEST:g}; choose 3 points not on a line and a fourth off their plane"
        )


def steps_needed(robot: Array, camera: Array) -> int:
    """Iterations that points (4, 3) need, with some to spare."""
    H = (robot - robot.mean(axis=0)).T @ (camera - camera.mean(axis=0))
    if np.linalg.det(H) <= 0.0:
        raise PlumblineError(
            "registration: the points in the camera are the mirror image of the robot's; check "
            "their order and the axes of the camera"
        )
    Y, steps = H, 0
    while np.abs(Y.T @ Y - np.eye(3)).max() > ORTHONORMAL and steps < MOST_STEPS:
        scale = abs(np.linalg.det(Y)) ** (-1.0 / 3.0)
        Y, steps = (scale * Y + np.linalg.inv(Y).T / scale) / 2.0, steps + 1
    return steps + SPARE_STEPS


@dataclass(frozen=True, eq=False)
class Registered:
    """``T_robot_camera`` in symbols, with its derivatives."""

    robot: cs.SX  # points in the robot's frame (3, 4) [m], functions of x
    camera: Array  # the same in the camera's (4, 3) [m]
    steps: int  # Newton iterations
    x: cs.SX  # the unknowns (P,)

    @cached_property
    def _R(self) -> cs.SX:
        return _polar(self._H, self.steps)

    @property
    def _H(self) -> cs.SX:
        return self.robot @ cs.DM(self.camera - self.camera.mean(axis=0))

    @property
    def _to_H(self) -> cs.DM:
        """What takes the points (12,) to H (9,): deviations sum to zero, means drop out."""
        return cs.kron(cs.DM(self.camera - self.camera.mean(axis=0)).T, cs.DM.eye(3))

    @property
    def value(self) -> cs.SX:
        """Columns of R, then t (12,)."""
        t = cs.sum2(self.robot) / COUNT - self._R @ cs.DM(self.camera.mean(axis=0))
        return cs.vertcat(cs.vec(self._R), t)

    @cached_property
    def _points_slope(self) -> cs.SX:
        return cs.jacobian(cs.vec(self.robot), self.x)

    @property
    def slope(self) -> cs.SX:
        """Derivative by the unknowns (12, P)."""
        return self._by_points(self._R, self._H) @ self._points_slope

    def _by_points(self, R: cs.SX, H: cs.SX) -> cs.SX:
        """Derivative by the points (12, 12)."""
        dR = _spin(R, R.T @ H) @ self._to_H
        middle = cs.kron(cs.DM(self.camera.mean(axis=0)).T, cs.DM.eye(3))
        return cs.vertcat(dR, cs.DM(np.tile(np.eye(3) / COUNT, COUNT)) - middle @ dR)


def _spin(R: cs.SX, S: cs.SX) -> cs.SX:
    """Derivative of R by H (9, 9), both column by column."""
    turn, change, stiff = cs.SX.sym("R", 3, 3), cs.SX.sym("dH", 3, 3), cs.SX.sym("W", 3, 3)
    moved = turn @ cs.skew(stiff @ (2 * unskew(turn.T @ change)))
    linear = cs.jacobian(cs.vec(moved), cs.vec(change))
    weights = cs.inv(cs.trace(S) * cs.SX.eye(3) - S)
    return cs.Function("spin", [turn, stiff], [linear])(R, weights)


def _polar(H: cs.SX, steps: int) -> cs.SX:
    entries = cs.SX.sym("Y", 3, 3)
    c0, c1, c2 = (entries[:, k] for k in range(3))
    cofactors = cs.horzcat(cs.cross(c1, c2), cs.cross(c2, c0), cs.cross(c0, c1))
    size = cs.dot(c0, cofactors[:, 0])
    scale = cs.fabs(size) ** (-1.0 / 3.0)
    better = (scale * entries + cofactors / (scale * size)) / 2
    step = cs.Function("polar_step", [entries], [better])
    for _ in range(steps):
        H = step(H)
    return H


def spread_rows(points: Array) -> tuple[int, ...]:
    """Four rows of points (N, 3), each farthest from the span of those before; refused if flat."""
    if len(points) < COUNT:
        raise PlumblineError(f"registration: {len(points)} rows, at least {COUNT} needed")
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    for _ in range(COUNT - 1):
        base = points - points[chosen[0]]
        span = np.linalg.qr(base[chosen[1:]].T)[0] if len(chosen) > 1 else np.zeros((3, 0))
        chosen.append(int(np.argmax(np.linalg.norm(base - base @ span @ span.T, axis=1))))
    check_points(points[chosen])
    return tuple(sorted(chosen))

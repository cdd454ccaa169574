r"""The frame that three markers span, once in CT and once by the robot; no Procrustes.

.. math:: e_1 = \frac{M_2 - M_1}{|M_2 - M_1|}, \quad
          e_3 = \frac{(M_2 - M_1) \times (M_3 - M_1)}{|\cdot|}, \quad e_2 = e_3 \times e_1

.. math:: R_{RC} = R_{RM} R_{CM}^T, \qquad f_R = R_{RC} (f_C - M_{1C}) + M_{1R}

(Chen Guangbiao et al., three-marker lesion localisation, eqs. 2-9, rebuilt.) The origin is the
first marker, the first axis points to the second, and the third gives the plane: their order
matters, and errors of a marker are not evened out by the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import Transform, unskew
from plumbline.optim.core.problem import Array
from plumbline.optim.registration.checks import smallest_angles
from plumbline.optim.registration.constants import CHUNK_OF_TRIPLES, ON_A_LINE
from plumbline.optim.registration.markers import MarkerNoise, Markers
from plumbline.optim.registration.method import Fit


def marker_frame(m1: cs.SX, m2: cs.SX, m3: cs.SX) -> cs.SX:
    """Axes ``[e1 e2 e3]`` (3, 3) of three markers (3,) [m]: ``R_CM`` in CT, ``R_RM`` in R."""
    along = m2 - m1
    normal = cs.cross(along, m3 - m1)
    e1, e3 = along / cs.norm_2(along), normal / cs.norm_2(normal)
    return cs.horzcat(e1, cs.cross(e3, e1), e3)


def three_point(ct: Sequence[cs.SX], robot: Sequence[cs.SX]) -> Transform:
    """``T_RC`` in symbols from three markers (3,) in CT and the same by the robot [m]."""
    R_CM, R_RM = marker_frame(*ct), marker_frame(*robot)
    R_RC = R_RM @ R_CM.T
    return Transform(R_RC, robot[0] - R_RC @ ct[0])


@lru_cache(maxsize=1)
def localisation() -> cs.Function:
    """``f_R`` (3,) and ``T_RC`` (4, 4) as a function of the 18 coordinates and the target ``f_C``.

    Inputs: ``ct`` (3, 3) and ``robot`` (3, 3), one column a marker, and ``target`` (3,) [m].
    """
    ct, robot, target = cs.SX.sym("ct", 3, 3), cs.SX.sym("robot", 3, 3), cs.SX.sym("target", 3)
    T_RC = three_point(cs.horzsplit(ct), cs.horzsplit(robot))
    matrix = cs.vertcat(cs.horzcat(T_RC.R, T_RC.t), cs.DM([[0, 0, 0, 1]]))
    names = ["ct", "robot", "target"], ["f_R", "T_RC"]
    outputs = [cs.densify(T_RC.point(target)), cs.densify(matrix)]
    return cs.Function("localisation", [ct, robot, target], outputs, *names)


@lru_cache(maxsize=1)
def _sensitivity_of_row() -> cs.Function:
    """Derivative (6, 18), transposed, of the image of the middle [m/m] and the turn [rad/m]."""
    row, R_RC_here = cs.SX.sym("row", 18), cs.SX.sym("R", 3, 3)
    middle = cs.SX.sym("middle", 3)
    ct, robot = (cs.reshape(part, 3, 3) for part in (row[:9], row[9:]))
    T_RC = three_point(cs.horzsplit(ct), cs.horzsplit(robot))
    moved = cs.vertcat(T_RC.point(middle), unskew(T_RC.R @ R_RC_here.T))
    here = [T_RC.R, cs.sum2(ct) / 3]
    (jacobian,) = cs.substitute([cs.jacobian(moved, row)], [R_RC_here, middle], here)
    return cs.Function("sensitivity_of_row", [row], [cs.densify(jacobian.T)], {"cse": True})


@lru_cache(maxsize=1)
def _pose_of_row() -> cs.Function:
    """``T_RC`` (4, 4), transposed, of a row (18,): three markers of CT, then of the robot."""
    row = cs.SX.sym("row", 18)
    ct, robot = (cs.reshape(part, 3, 3) for part in (row[:9], row[9:]))
    T_RC = three_point(cs.horzsplit(ct), cs.horzsplit(robot))
    matrix = cs.vertcat(cs.horzcat(T_RC.R, T_RC.t), cs.DM([[0, 0, 0, 1]]))
    return cs.Function("pose_of_row", [row], [cs.densify(matrix.T)], {"cse": True})


def three_point_batch(ct: Array, robot: Array) -> Array:
    """``T_RC`` (..., 4, 4) of triples (..., 3, 3) [m], one row a marker; NaN if on one line."""
    shape = np.broadcast_shapes(ct.shape, robot.shape)
    rows = _rows(np.broadcast_to(ct, shape), np.broadcast_to(robot, shape))
    return in_chunks(_pose_of_row(), rows).reshape(*shape[:-2], 4, 4)


def sensitivities(ct: Array, robot: Array) -> Array:
    """Derivatives (K, 6, 3, 6) of triples' poses (K, 3, 3), at their middles, CT first."""
    J = in_chunks(_sensitivity_of_row(), _rows(ct, robot)).reshape(-1, 6, 2, 3, 3)
    return np.concatenate([J[:, :, 0], J[:, :, 1]], axis=-1)


def _rows(ct: Array, robot: Array) -> Array:
    """Rows (K, 18) of triples (..., 3, 3)."""
    return np.concatenate([ct.reshape(-1, 9), robot.reshape(-1, 9)], axis=1)


def in_chunks(function: cs.Function, rows: Array) -> Array:
    """The only output of a function, transposed, at rows (N, k): (N, c, r)."""
    parts = []
    for start in range(0, len(rows), CHUNK_OF_TRIPLES):
        part = rows[start : start + CHUNK_OF_TRIPLES]
        padded = np.arange(1 << (len(part) - 1).bit_length()) % len(part)
        parts.append(over_rows(function, part[padded])[0][: len(part)])
    if not parts:
        return over_rows(function, rows)[0]
    return np.concatenate(parts)


@dataclass(frozen=True)
class ThreePoint:
    """The three-point frame as a method.

    Attributes:
        triple: Which three markers (from 0), in the order M1, M2, M3; all others only check it.
    """

    triple: tuple[int, int, int] = (0, 1, 2)

    name: ClassVar[str] = "three-point"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers."""
        k = list(self.triple)
        if not set(k) <= set(range(len(markers))) or len(set(k)) != 3:
            mend = "name three different markers"
            raise fault("triple", f"{self.triple}", f"indices below {len(markers)}", mend)
        ct, robot = markers.ct[k], markers.robot[k]
        _check_plane(markers.select(k))
        T_RC, middle = three_point_batch(ct, robot), ct.mean(axis=0)
        jacobian = np.zeros((6, len(markers), 6))
        jacobian[:, k] = sensitivities(ct, robot)[0]
        return Fit(T_RC, T_RC[:3, :3] @ middle + T_RC[:3, 3], jacobian, tuple(k))

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m]; noise changes nothing."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        return three_point_batch(c[..., self.triple, :], r[..., self.triple, :])


def _check_plane(triple: Markers) -> None:
    """Refuse a triple that spans no plane, whatever the other markers do."""
    for what, points in (("ct", triple.ct), ("robot", triple.robot)):
        angle = float(smallest_angles(points))
        if angle < ON_A_LINE:
            where = f"triple {', '.join(triple.labels)}, {what}"
            found, mend = f"one line within {angle:.2g} deg", "choose another triple"
            raise fault(where, found, f"at least {ON_A_LINE:g} deg", mend)

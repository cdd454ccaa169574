r"""The least-squares registration of one marker, in symbols; the markers are rows.

.. math:: d = q - (A p + t), \qquad S = A\, \Sigma_C A^T + \Sigma_R, \qquad r = L^{-1} d,
          \quad L L^T = S

.. math:: A p + t \leftarrow c + v + (1 + s) \exp(w)\, (A p + t - c)

Summing :math:`|r|^2` over the markers is the likelihood with the markers' true places eliminated:
generalised total least squares, with a full covariance in either frame (Ohta and Kanatani 1998,
ECCV, sec. 2; Balachandran and Fitzpatrick 2009, SPIE 7261). With :math:`\Sigma_C = 0` and
:math:`\Sigma_R = I` it is the plain rigid fit. Unknowns are a displacement v [m] at a centre c, a
rotation vector w [rad] and, if wanted, a relative scale s, all zero at the pose (A, t) of the row.
"""

from dataclasses import dataclass
from functools import cache, lru_cache

import casadi as cs
import numpy as np

from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import rotation
from plumbline.optim.core.problem import Array, Problem
from plumbline.optim.registration.constants import POSE
from plumbline.optim.registration.markers import Markers


@dataclass(frozen=True, eq=False)
class MarkerSymbols:
    """Symbols of one marker."""

    x: cs.SX  # unknowns (6,) or (7,)
    marker: cs.SX  # the marker's row (18,): p, q, upper triangles of both covariances
    pose: cs.SX  # the pose about which x is taken (15,)
    residual: cs.SX  # whitened misfit r (3,), without unit


@lru_cache(maxsize=4)
def statement(scale: bool = False, *, near: bool = False) -> MarkerSymbols:
    """One marker's residual, with an unknown scale or not; ``near`` zero to second order."""
    x, marker, pose = cs.SX.sym("x", 7 if scale else 6), cs.SX.sym("m", 18), cs.SX.sym("T", POSE)
    A, t, c = cs.reshape(pose[:9], 3, 3), pose[9:12], pose[12:]
    w = cs.skew(x[3:6])
    turn = cs.SX.eye(3) + w + w @ w / 2 if near else rotation(x[3:6])
    turn = turn * (1 + x[6]) if scale else turn
    image = c + x[:3] + turn @ (A @ marker[:3] + t - c)
    spread = turn @ A
    covariance = spread @ _symmetric(marker[6:12]) @ spread.T + _symmetric(marker[12:18])
    residual = cs.solve(cs.chol(covariance).T, marker[3:6] - image)
    return MarkerSymbols(x, marker, pose, residual)


def _symmetric(upper: cs.SX) -> cs.SX:
    a, b, c, d, e, f = (upper[k] for k in range(6))
    return cs.vertcat(cs.horzcat(a, b, c), cs.horzcat(b, d, e), cs.horzcat(c, e, f))


@cache
def _derivatives() -> cs.Function:
    """Hessian and gradient of ``r^T r / 2`` at x = 0, and ``r^T r``, of a row."""
    s = statement(False, near=True)
    hessian, gradient = cs.hessian(cs.sumsqr(s.residual) / 2, s.x)
    return _at_zero(s, "derivatives", [hessian, gradient, cs.sumsqr(s.residual)])


@lru_cache(maxsize=2)
def _mixed(scale: bool) -> cs.Function:
    """Derivatives of ``r^T r / 2`` at x = 0: twice by x (k, k), by x and the places (k, 6)."""
    s = statement(scale, near=True)
    gradient = cs.gradient(cs.sumsqr(s.residual) / 2, s.x)
    outputs = [cs.jacobian(gradient, s.x), cs.jacobian(gradient, s.marker[:6])]
    return _at_zero(s, "mixed", outputs)


def _at_zero(s: MarkerSymbols, name: str, outputs: list[cs.SX]) -> cs.Function:
    here = cs.substitute(outputs, [s.x], [cs.DM.zeros(s.x.shape)])
    row = cs.vertcat(s.marker, s.pose)
    dense = [cs.densify(value) for value in here]
    return cs.Function(name, [row], dense, {"cse": True})


def with_pose(rows: Array, T: Array, centre: Array) -> Array:
    """Rows (N, n, 18) with the pose (N, 4, 4) and centre (N, 3) of their draw, (N n, 33)."""
    A = np.swapaxes(T[..., :3, :3], -1, -2).reshape(len(T), 9)
    pose = np.concatenate([A, T[:, :3, 3], centre], axis=1)
    count = rows.shape[1]
    full = np.empty((len(T), count, 18 + POSE))
    full[..., :18], full[..., 18:] = rows, pose[:, None]
    return full.reshape(-1, 18 + POSE)


def derivatives(rows: Array, T: Array, centre: Array) -> tuple[Array, Array, Array]:
    """Hessians (N, k, k), gradients (N, k) and squares (N,) of N draws of n markers."""
    table, shape = with_pose(rows, T, centre), rows.shape[:2]
    # A map is made for each number of rows: powers of two, so that few are made.
    count = len(table)
    padded = np.arange(1 << (count - 1).bit_length()) % count
    H, g, square = (v[:count] for v in over_rows(_derivatives(), table[padded]))
    k = H.shape[-1]
    return (
        H.reshape(*shape, k, k).sum(axis=1),
        g.reshape(*shape, k).sum(axis=1),
        square.reshape(shape).sum(axis=1),
    )


def sensitivity(markers: Markers, T: Array, centre: Array, *, scale: bool = False) -> Array:
    r"""Derivative (k, n, 6) of the minimum by each marker's places, CT first.

    .. math:: \frac{dx}{dm} = -\Big[\frac{\partial^2 F}{\partial x^2}\Big]^{-1}
              \frac{\partial^2 F}{\partial x\, \partial m}

    The implicit function theorem at the stationary point, with the full Hessian: exact for any
    size of residual, as long as the pose is the minimum.
    """
    rows = with_pose(markers.rows[None], T[None], centre[None])
    H, C = over_rows(_mixed(scale), rows)
    mixed = np.moveaxis(C, -1, 0)  # (k, n, 6)
    k = len(mixed)
    solved = np.linalg.solve(H.sum(axis=0), mixed.reshape(k, -1))
    return -solved.reshape(mixed.shape)


def problem(markers: Markers, T: Array, centre: Array) -> Problem:
    """The rigid fit as a problem for any solver, in displacements from a start ``T`` (4, 4)."""
    s = statement()
    pose = np.concatenate([T[:3, :3].T.ravel(), T[:3, 3], centre])
    bound = np.array([np.inf] * 3 + [np.pi] * 3)
    return Problem(
        x=s.x,
        names=("x", "y", "z", "rx", "ry", "rz"),
        lower=-bound,
        upper=bound,
        scale=np.array([1e-3] * 3 + [1e-2] * 3),
        residual=cs.substitute(s.residual, s.pose, cs.DM(pose)),
        row=s.marker,
        rows=markers.rows,
    )

"""Pinocchio's word on planned postures: nothing of a plan's quality is taken from its solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from plumbline.optim.pointing.aim import Aim
from plumbline.optim.pointing.constants import EQUATIONS
from plumbline.optim.pointing.given import Array


@dataclass(frozen=True, eq=False)
class Checked:
    """What Pinocchio finds at postures; NaN where a posture is."""

    rcm_error: Array  # distance of the tool centre point from the lesion (N,) [m]
    direction_error: Array  # angle between the needle and the wanted direction (N,) [rad]
    singular_value: Array  # smallest singular value of the needle's task (N,) [rad/rad]


def checked(aim: Aim, q: Array, theta: Array, beta: Array) -> Checked:
    """Postures (N, n) for angles (N,) [rad], by Pinocchio's kinematics and Jacobians."""
    model = aim.chain.model
    data = model.createData()
    T_last_tip = pin.SE3(aim.chain.T_last_tip)
    axis, steps = np.asarray(aim.needle.axis), _steps(aim)
    inward = -aim.outward(theta, beta)
    found = np.full((len(q), 3), np.nan)
    for k in np.flatnonzero(np.isfinite(q).all(axis=1)):
        configuration = aim.chain.configuration(q[k])
        pin.computeJointJacobians(model, data, configuration)
        T = data.oMi[aim.chain.n] * T_last_tip
        needle = T.rotation @ axis
        arm = aim.needle.reach * needle
        point = T.translation + arm
        J = pin.getJointJacobian(model, data, aim.chain.n, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        lever = point - data.oMi[aim.chain.n].translation
        at_point = J[:3] - pin.skew(lever) @ J[3:]
        task = np.vstack([at_point / aim.needle.reach, -pin.skew(needle) @ J[3:]]) * steps
        sizes = np.linalg.svd(task, compute_uv=False)
        away = np.linalg.norm(point - aim.target)
        turned = np.arctan2(np.linalg.norm(np.cross(needle, inward[k])), needle @ inward[k])
        found[k] = away, turned, sizes[EQUATIONS - 1]
    return Checked(found[:, 0], found[:, 1], found[:, 2])


def _steps(aim: Aim) -> Array:
    turning = np.array(aim.chain.kinds) == "revolute"
    return np.where(turning, 1.0, aim.chain.reach)


def drift(aim: Aim, q: Array) -> Array:
    """How far the tool centre point is from the lesion midway to each posture (K,) [m]."""
    found = np.zeros(len(q))
    middle = (q[1:] + q[:-1]) / 2
    angles = np.zeros(len(middle))
    found[1:] = checked(aim, middle, angles, angles).rcm_error
    return found

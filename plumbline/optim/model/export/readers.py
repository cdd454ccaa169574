"""An exported file alone, by those who read it: Pinocchio a URDF, MuJoCo an MJCF."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array


def has_mujoco() -> bool:
    """Whether MuJoCo is installed."""
    return find_spec("mujoco") is not None


def frames_by_pinocchio(text: str, tip: str, q: Array) -> Array:
    """``T_base_tip`` (N, 4, 4) [m] of a URDF at joints (N, n)."""
    chain = Robot.from_urdf(text).chain(tip)
    data, frame = chain.model.createData(), chain.model.getFrameId(tip, pin.FrameType.BODY)
    found = np.empty((len(q), 4, 4))
    for T, posture in zip(found, q, strict=True):
        pin.framesForwardKinematics(chain.model, data, chain.configuration(posture))
        T[:] = data.oMf[frame].homogeneous
    return found


def torques_by_pinocchio(chain: Chain, q: Array, v: Array, a: Array) -> Array:
    """Efforts (N, n) [N m or N] of a chain read from a URDF, its damping and friction with them."""
    model, data = chain.model, chain.model.createData()
    rows = zip(map(chain.configuration, q), v, a, strict=True)
    bodies = np.array([pin.rnea(model, data, *row) for row in rows])
    return np.asarray(bodies + model.damping * v + model.friction * np.sign(v))


def frames_by_mujoco(text: str, site: str, q: Array) -> Array:
    """``T_base_site`` (N, 4, 4) [m] of an MJCF at joints (N, n)."""
    mujoco: Any = import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    found = np.tile(np.eye(4), (len(q), 1, 1))
    for T, posture in zip(found, q, strict=True):
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        T[:3, :3], T[:3, 3] = data.site(site).xmat.reshape(3, 3), data.site(site).xpos
    return found


def torques_by_mujoco(text: str, q: Array, v: ArrayLike, a: ArrayLike) -> Array:
    """Efforts (N, n) [N m or N] of an MJCF by its inverse dynamics."""
    mujoco: Any = import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    found = np.empty_like(q)
    for tau, row in zip(found, zip(q, np.asarray(v), np.asarray(a), strict=True), strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(model, data)
        tau[:] = data.qfrc_inverse
    return found

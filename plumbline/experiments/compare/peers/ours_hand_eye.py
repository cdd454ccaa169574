"""Our frame and tool of a recording of poses: what every diagnosis fits first."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version as version_of

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from plumbline.kinematics.robot import Robot
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.refit import refit
from plumbline.optim.recording.building import build_recording

Array = NDArray[np.float64]


def version() -> str:
    """Of plumbline."""
    return version_of("plumbline-robotics")


def fit(given: Mapping[str, Array]) -> Array:
    """The tool in the flange ``T`` (M, 4, 4) [m] of M set-ups."""
    robot = Robot.bundled("ur5")
    return np.array([_tool(robot, q, T) for q, T in zip(given["q"], given["seen"], strict=True)])


def _tool(robot: Robot, q: Array, seen: Array) -> Array:
    turned = Rotation.from_matrix(seen[:, :3, :3]).as_quat(scalar_first=True)
    measured = np.column_stack([seen[:, :3, 3], turned])
    recording = build_recording(
        observation="pose", robot=robot, q=q, measured=measured, tool_offset=np.zeros(3)
    )
    solution = refit(recording, (), np.empty(0))
    n = nuisances_of(recording)
    made = cs.Function("tool", [n.x], [cs.densify(n.R_tip_tool), cs.densify(n.tool)])
    R, t = (part.full() for part in made.call([cs.DM(solution.x)]))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t.ravel() + recording.tool_offset
    return T


def figures(given: Mapping[str, Array], found: Array) -> dict[str, float]:
    """Mean error of the tool's place [mm] and of its turn [mrad]."""
    apart = np.linalg.inv(given["tool"]) @ found
    angle = np.arccos(np.clip((np.trace(apart[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    place = np.linalg.norm(apart[:, :3, 3], axis=1)
    return {"error": 1e3 * float(place.mean()), "turn": 1e3 * float(angle.mean())}

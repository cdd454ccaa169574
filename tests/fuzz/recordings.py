"""Sound recordings of every kind, as the text of their files, to be damaged."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.robot import Robot

ROWS = 30  # of a sound recording: enough for every command to read it
NOISE = 1e-4  # [m]
TOOL = (0.01, 0.0, 0.12)  # [m]
DEVICE = Rotation.from_euler("xyz", [0.3, -0.2, 1.1])
Files = Mapping[str, str]
Column = NDArray[Any]
URDF = """<?xml version="1.0"?>
<robot name="rail">
  <link name="base"/><link name="cart"/><link name="upper"><inertial><mass value="2.0"/>
    <origin xyz="0 0 0.1" rpy="0 0 0"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="lower"/><link name="tip"/><link name="lamp"/>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/>
    <axis xyz="1 0 0"/><limit lower="-1.5" upper="1.5" effort="10" velocity="1"/></joint>
  <joint name="shoulder" type="revolute"><parent link="cart"/><child link="upper"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2.0" upper="2.0" effort="10" velocity="1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="wrist" type="fixed"><parent link="lower"/><child link="tip"/>
    <origin xyz="0.2 0 0"/></joint>
  <joint name="lamp" type="revolute"><parent link="base"/><child link="lamp"/><axis xyz="0 0 1"/>
    <limit lower="-1.0" upper="1.0" effort="10" velocity="1"/></joint>
</robot>
"""
DH = "\n".join(
    f"[[robot.dh]]\nd = {d}\na = {a}\nalpha = {alpha}\n"
    for d, a, alpha in ((0.3, 0.0, 1.5708), (0.0, 0.4, 0.0), (0.0, 0.3, 0.0), (0.1, 0.0, -1.5708))
)
MARKERS = np.array([[10, 20, 147], [110, 120, 147], [60, -10, 80], [90, -10, 20], [50, 130, 63]])


def sound(kind: str) -> Files:
    """The files of a sound recording of a kind of :data:`KINDS`."""
    return MAKERS[kind](kind)


def _arm(kind: str, rows: int = ROWS) -> Files:
    """The bundled UR5 seen as ``diagnose`` reads it."""
    chain, rng = Robot.bundled("ur5").chain(), np.random.default_rng(3)
    q = rng.uniform(-2.5, 2.5, (rows, 6))
    columns: dict[str, Column] = {f"q{j + 1}": q[:, j] for j in range(6)} | _measured(
        kind, chain, q, rng
    )
    columns |= {"time": 2.0 * np.arange(rows), "temperature": np.full(rows, 21.5)}
    columns |= {f"direction{j + 1}": np.where(q[:, j] > 0, 1.0, -1.0) for j in range(6)}
    columns |= {"group": np.arange(rows) // 10, "held_out": (np.arange(rows) >= 20).astype(float)}
    return {"dataset.toml": _settings(kind, 'bundled = "ur5"'), "samples.csv": _csv(columns)}


def _rail(kind: str) -> Files:
    """An arm on a linear axis, from a URDF of two branches."""
    robot, rng = Robot.from_urdf(URDF), np.random.default_rng(4)
    chain = robot.chain("tip")
    names = [str(name) for name in robot.model.names][1:]
    q = rng.uniform(-0.9, 0.9, (ROWS, len(names)))
    own = q[:, [names.index(name) for name in chain.joint_names]]
    columns: dict[str, Column] = {f"q{j + 1}": q[:, j] for j in range(len(names))}
    columns |= _measured("tip_position", chain, own, rng)
    toml = _settings("tip_position", 'urdf = "robot.urdf"\ntip_frame = "tip"')
    return {"dataset.toml": toml, "samples.csv": _csv(columns), "robot.urdf": URDF}


def _rows_of_dh(kind: str) -> Files:
    """An arm written down as rows of Denavit and Hartenberg."""
    rows = [{"d": 0.3, "alpha": 1.5708}, {"a": 0.4}, {"a": 0.3}, {"d": 0.1, "alpha": -1.5708}]
    chain, rng = Robot.from_dh(rows).chain(), np.random.default_rng(5)
    q = rng.uniform(-2.0, 2.0, (ROWS, 4))
    columns: dict[str, Column] = {f"q{j + 1}": q[:, j] for j in range(4)}
    columns |= _measured("tip_position", chain, q, rng)
    return {"dataset.toml": _settings("tip_position", DH), "samples.csv": _csv(columns)}


def _measured(kind: str, chain: Chain, q: Array, rng: np.random.Generator) -> dict[str, Column]:
    T = chain.placement(q)
    tips = DEVICE.apply(T[:, :3, :3] @ np.array(TOOL) + T[:, :3, 3])
    tips = tips + rng.normal(0.0, NOISE, tips.shape)
    turns = (DEVICE * Rotation.from_matrix(T[:, :3, :3])).as_quat()[:, [3, 0, 1, 2]]
    if kind == "fixed_point":
        return {"socket": np.arange(len(q)) % 4.0}
    if kind == "joint_position":
        return {f"m{j + 1}": q[:, j] + rng.normal(0.0, NOISE, len(q)) for j in range(chain.n)}
    found = dict(zip("xyz", tips.T, strict=True))
    if kind == "pose":
        found |= dict(zip(("qw", "qx", "qy", "qz"), turns.T, strict=True))
    return found


def _ranges(kind: str) -> Files:
    """A range finder on three planes, flange poses given; boards of other readings are marks."""
    rng = np.random.default_rng(6)
    where = rng.uniform((-0.2, -0.2, 0.3), (0.2, 0.2, 0.7), (36, 3))
    turn = Rotation.random(36, rng=7).as_quat()[:, [3, 0, 1, 2]]
    columns: dict[str, Column] = dict(zip(("px", "py", "pz"), where.T, strict=True))
    columns |= dict(zip(("qw", "qx", "qy", "qz"), turn.T, strict=True))
    columns |= {"range": rng.uniform(0.2, 0.6, 36), "plane": 1.0 + np.arange(36) // 12}
    columns |= {"motion": 1.0 + np.arange(36) // 6, "mark": np.repeat([0.0, 1.0], [33, 3])}
    return {"dataset.toml": _plain(kind, "noise_std = 1.0e-3\n"), "samples.csv": _csv(columns)}


def _fiducials(kind: str) -> Files:
    """Markers and a target of a phantom, in CT and by the robot [m]."""
    ct = 1e-3 * MARKERS
    robot = DEVICE.apply(ct) + np.array([0.5, -0.3, 0.6])
    lines = ["label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z"]
    for k, label in enumerate("ABCDM"):
        numbers = [f"{v:.9g}" for v in ct[k]] + [f"{v:.9g}" for v in robot[k]]
        cells = [*numbers[:3], "", "", ""] if label == "M" else numbers
        lines.append(",".join([label, "target" if label == "M" else "marker", *cells]))
    noise = "[noise]\nct_std = 4.0e-4\nrobot_std = 3.0e-4\n"
    return {"dataset.toml": _plain(kind, noise), "samples.csv": "\n".join(lines) + "\n"}


def _tracking(kind: str) -> Files:
    """An instrument's commanded speed and measured place over time."""
    time = 0.02 * np.arange(2 * ROWS)  # longer than the second that a motion takes at least
    columns: dict[str, Column] = {"time": time, "u1": np.sin(time), "u2": np.cos(time)}
    columns |= {"x1": -np.cos(time), "x2": np.sin(time)}
    return {"dataset.toml": _plain(kind, ""), "samples.csv": _csv(columns)}


def _settings(kind: str, robot: str) -> str:
    tool = f"[tool]\noffset = {list(TOOL)}\n\n" if kind != "joint_position" else ""
    always = '[fit]\nalways = ["frame", "tool"]\n'
    gravity = "" if "dh" in robot else "gravity = [0.0, 0.0, -9.81]\n"
    table = robot if "dh" in robot else f"[robot]\n{robot}\n{gravity}"
    return f"{_plain(kind, f'noise_std = {NOISE}')}\n\n{table}\n{tool}{always}"


def _plain(kind: str, more: str) -> str:
    return f'name = "sound"\nobservation = "{kind}"\n{more}'


def _csv(columns: Mapping[str, Column]) -> str:
    rows = (",".join(f"{v:.9g}" for v in row) for row in zip(*columns.values(), strict=True))
    return "\n".join([",".join(columns), *rows]) + "\n"


MAKERS: Mapping[str, Callable[[str], Files]] = {
    "tip_position": _arm,
    "pose": _arm,
    "fixed_point": _arm,
    "joint_position": _arm,
    "rail": _rail,
    "dh": _rows_of_dh,
    "plane_range": _ranges,
    "fiducials": _fiducials,
    "tracking": _tracking,
}
KINDS = tuple(MAKERS)

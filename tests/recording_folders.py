"""Small recording folders for tests: a bundled arm seen through a rigid frame, with known noise."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.loading import load_recording

ROWS = 40
KINDS = ("tip_position", "pose", "fixed_point", "joint_position", "slider")
TOOL = np.array([0.01, 0.0, 0.12])
R_DEVICE_BASE = Rotation.from_euler("xyz", [0.3, -0.2, 1.1])
T_DEVICE_BASE = np.array([2.0, -1.0, 0.5])
URDF = """<?xml version="1.0"?>
<robot name="slider">
  <link name="base"/>
  <link name="arm"/>
  <link name="slide"/>
  <link name="tip"/>
  <link name="camera"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="arm"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2.0" upper="2.0" effort="10" velocity="1"/>
  </joint>
  <joint name="pan" type="revolute">
    <parent link="base"/><child link="camera"/><axis xyz="0 0 1"/>
    <limit lower="-1.0" upper="1.0" effort="10" velocity="1"/>
  </joint>
  <joint name="insertion" type="prismatic">
    <parent link="arm"/><child link="slide"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
    <limit lower="0.0" upper="0.25" effort="10" velocity="1"/>
  </joint>
  <joint name="roll" type="revolute">
    <parent link="slide"/><child link="tip"/><axis xyz="1 0 0"/>
    <limit lower="-2.5" upper="2.5" effort="10" velocity="1"/>
  </joint>
</robot>
"""
SETTINGS = """name = "bench"
observation = "tip_position"
noise_std = 1.0e-4

[robot]
bundled = "ur5"
tip_frame = "flange"
gravity = [0.0, 0.0, -9.81]

[tool]
offset = [0.01, 0.0, 0.12]

[fit]
always = ["frame", "tool"]
"""
URDF_SETTINGS = SETTINGS.replace('bundled = "ur5"', 'urdf = "robot.urdf"').replace("flange", "tip")


def postures(rows: int = ROWS) -> np.ndarray:
    """Joint readings (N, 6) [rad], most of them beyond one radian somewhere."""
    return np.random.default_rng(3).uniform(-2.5, 2.5, (rows, 6))


def poses(robot: Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tips (N, 3) [m] and quaternions (N, 4), w first, in the device's frame."""
    T_base_tip = robot.chain().placement(q)
    tips = T_base_tip[:, :3, :3] @ TOOL + T_base_tip[:, :3, 3]
    noise = np.random.default_rng(4).normal(0.0, 1e-4, tips.shape)
    turns = R_DEVICE_BASE * Rotation.from_matrix(T_base_tip[:, :3, :3])
    return R_DEVICE_BASE.apply(tips) + T_DEVICE_BASE + noise, turns.as_quat()[:, [3, 0, 1, 2]]


def columns(kind: str = "tip_position") -> dict[str, np.ndarray]:
    """Columns of a good ``samples.csv`` for the bundled arm."""
    q = postures()
    tips, quaternions = poses(Robot.bundled("ur5"), q)
    table = {f"q{j + 1}": q[:, j] for j in range(6)}
    if kind in ("tip_position", "pose"):
        table |= dict(zip("xyz", tips.T, strict=True))
    if kind == "pose":
        table |= dict(zip(("qw", "qx", "qy", "qz"), quaternions.T, strict=True))
    if kind == "fixed_point":
        table["socket"] = np.arange(ROWS) % 4
    if kind == "joint_position":
        table |= {f"m{j + 1}": q[:, j] + 1e-3 for j in range(6)}
    context = {"time": 2.0 * np.arange(ROWS), "temperature": np.full(ROWS, 21.5)}
    context |= {f"direction{j + 1}": np.where(q[:, j] > 0, 1, -1) for j in range(6)}
    return table | context | {"group": np.arange(ROWS) // 10, "held_out": np.arange(ROWS) // 30}


def slider_columns() -> dict[str, np.ndarray]:
    """Columns for the arm of ``URDF``: all four movable joints, the camera's among them."""
    rng = np.random.default_rng(5)
    robot = Robot.from_urdf(URDF)
    names = [str(name) for name in robot.model.names][1:]
    span = {"shoulder": (-1.9, 1.9), "pan": (-1, 1), "insertion": (0, 0.25), "roll": (-2.4, 2.4)}
    q = {name: rng.uniform(*span[name], ROWS) for name in names}
    chain = robot.chain("tip")
    T = chain.placement(np.column_stack([q[name] for name in chain.joint_names]))
    tips = R_DEVICE_BASE.apply(T[:, :3, :3] @ TOOL + T[:, :3, 3])
    return {f"q{k + 1}": q[n] for k, n in enumerate(names)} | dict(zip("xyz", tips.T, strict=True))


def csv_text(table: dict[str, np.ndarray]) -> str:
    """The columns as CSV."""
    rows = zip(*table.values(), strict=True)
    return "\n".join([",".join(table), *(",".join(f"{v:.9g}" for v in r) for r in rows)]) + "\n"


def write_folder(folder: Path, kind: str = "tip_position") -> Path:
    """A good folder of that kind, or ``"slider"`` for the arm with a slide and a URDF."""
    folder.mkdir(parents=True, exist_ok=True)
    if kind == "slider":
        (folder / "robot.urdf").write_text(URDF)
        (folder / "dataset.toml").write_text(URDF_SETTINGS)
        (folder / "samples.csv").write_text(csv_text(slider_columns()))
        return folder
    settings = SETTINGS.replace("tip_position", kind)
    (folder / "dataset.toml").write_text(settings)
    (folder / "samples.csv").write_text(csv_text(columns(kind)))
    return folder


def complaint(folder, **options) -> str:
    """The one line with which a folder is refused."""
    with pytest.raises(PlumblineError) as caught:
        load_recording(folder, **options)
    message = str(caught.value)
    assert len(message.splitlines()) == 1, message
    return message


def with_columns(folder, change, kind="tip_position"):
    """A folder whose columns went through ``change(table)``."""
    write_folder(folder, kind)
    table = slider_columns() if kind == "slider" else columns(kind)
    (folder / "samples.csv").write_text(csv_text(change(dict(table)) or table))
    return folder


def with_text(folder, file, change, kind="tip_position"):
    """A folder one of whose files went through ``change(text)``, which must change it."""
    write_folder(folder, kind)
    old = (folder / file).read_text()
    assert change(old) != old
    (folder / file).write_text(change(old))
    return folder


def cell(row, column, text):
    """A change that puts text into one cell; row 1 is the header."""

    def change(csv):
        lines = csv.split("\n")
        cells = lines[row - 1].split(",")
        cells[lines[0].split(",").index(column)] = text
        lines[row - 1] = ",".join(cells)
        return "\n".join(lines)

    return change


def swap(old, new):
    """A change of the first place where a text stands."""
    return lambda text: text.replace(old, new, 1)


def scaled(factor, *names):
    """A change of the unit of some columns."""
    return lambda table: table | {name: factor * table[name] for name in names}

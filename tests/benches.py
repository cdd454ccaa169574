"""Small recordings of several robots with every optional column, and a model's residuals."""

import numpy as np
from scipy.spatial.transform import Rotation

from plumbline.kinematics.robot import Robot
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.stand_in import points_robot
from tests.random_trees import Tree

ROWS = 60
TOOL = np.array([0.02, -0.03, 0.15])
R_DEVICE_BASE = Rotation.from_euler("xyz", [0.3, -0.2, 1.1])
T_DEVICE_BASE = np.array([0.4, -0.3, 3.5])
COLUMNS = (
    "time", "temperature", "payload", "group", "direction", "velocity", "effort", "force",
)  # fmt: skip
ROBOTS = {
    "ur5": lambda: Robot.bundled("ur5"),
    "kr300": lambda: Robot.bundled("kr300"),
    "laparoscopic": lambda: Robot.bundled("laparoscopic"),
    "sweeping": lambda: Robot.bundled("ur5"),
    "seven": lambda: Robot.from_urdf(Tree(3, ("revolute",) * 7).urdf()),
}
BENCHES = (
    ("ur5", "tip_position"),
    ("ur5", "pose"),
    ("ur5", "fixed_point"),
    ("ur5", "joint_position"),
    ("kr300", "tip_position"),
    ("laparoscopic", "tip_position"),
    ("laparoscopic", "joint_position"),
    ("seven", "tip_position"),
    ("sweeping", "tip_position"),
    ("seven", "joint_torque"),
    ("ur5", "plane_range"),
    ("points", "fiducials"),
)


def readings(chain, rows=ROWS, seed=0):
    """Random postures over the joint ranges (rows, n)."""
    lower, upper = np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi)
    return np.random.default_rng(seed).uniform(lower, upper, (rows, chain.n))


def sweep(chain, rows=ROWS):
    """Postures of one motion from rest to rest, one joint after the other (rows, n)."""
    lower, upper = np.maximum(chain.lower, -1.0), np.minimum(chain.upper, 1.0)
    moment = np.linspace(-0.3, 0.3, chain.n)
    gone = np.tanh(4.0 * (np.linspace(-1.0, 1.0, rows)[:, None] - moment))
    return (lower + upper) / 2 + (upper - lower) / 2 * gone


def every_column(n, rows=ROWS, seed=0):
    """All optional columns, random but for the time."""
    rng = np.random.default_rng(seed + 1)
    return {
        "time": np.linspace(0.0, 90.0, rows),
        "temperature": rng.uniform(18.0, 35.0, rows),
        "payload": rng.uniform(0.0, 3.0, rows),
        "direction": rng.choice([-1.0, 1.0], (rows, n)),
        "velocity": rng.normal(0.0, 0.5, (rows, n)),
        "effort": rng.normal(0.0, 20.0, (rows, n)),
        "force": rng.normal(0.0, 2.0, (rows, 3)),
        "group": np.arange(rows) * 3 // rows + 1,
    }


def measured(chain, q, observation):
    """What a perfect device measures."""
    T = chain.placement(q)
    tips = T[:, :3, :3] @ TOOL + T[:, :3, 3]
    places = R_DEVICE_BASE.apply(tips) + T_DEVICE_BASE
    if observation == "fixed_point":
        return None
    if observation == "joint_position":
        return np.array(q)
    if observation == "tip_position":
        return places
    turns = R_DEVICE_BASE * Rotation.from_matrix(T[:, :3, :3])
    return np.hstack([places, turns.as_quat()[:, [3, 0, 1, 2]]])


def bench(robot, observation, *, columns=COLUMNS, q=None, **given):
    """A recording of a robot; every optional column is there unless ``columns`` says otherwise."""
    if observation == "fiducials":
        return _touches(columns)
    posture = sweep if robot == "sweeping" else readings
    robot = ROBOTS[robot]() if isinstance(robot, str) else robot
    chain = robot.chain()
    q = posture(chain) if q is None else q
    values = every_column(chain.n, len(q))
    values = {k: v for k, v in values.items() if k in columns and k not in given}
    if observation == "fixed_point":
        values["socket"] = np.arange(len(q)) % 4
    if observation == "joint_torque":
        v = values["velocity"]
        tau = robot.dynamics().torques(q, v, a := 3.0 * v[::-1, ::-1])
        values |= {"acceleration": a, "noise_by_joint": np.ones(chain.n), "measured": tau}
        values.pop("effort")
    if observation == "plane_range":
        return _ranges(robot, chain, q, values)
    return build_recording(
        observation=observation,
        robot=robot,
        q=q,
        tool_offset=TOOL,
        **{"measured": measured(chain, q, observation), **values, **given},
    )


def _ranges(robot, chain, q, values):
    """Ranges on the six faces of a box about the arm, each beam sent to the face that it meets."""
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    T, v = chain.placement(q), np.array([0.1, -0.2, 1.0]) / np.sqrt(1.05)
    start, way = T[:, :3, :3] @ TOOL + T[:, :3, 3], T[:, :3, :3] @ v
    face = np.argmax(way @ normals.T, axis=1)
    gap = 2.0 - np.sum(start * normals[face], axis=1)
    return Recording(
        name="box",
        observation="plane_range",
        robot=robot,
        chain=chain,
        tip_frame=chain.tip_frame,
        q=q,
        measured=(gap / np.sum(way * normals[face], axis=1))[:, None],
        tool_offset=TOOL,
        element=face + 1,
        motion=np.arange(len(q)) % 5,
        elements=tuple("123456"),
        anchor=(np.concatenate([TOOL, v]), np.hstack([2.0 * normals, normals])),
        always=(),
        **values,
    )


def _touches(columns):
    """Eight markers, each touched again and again."""
    rig = points_robot()
    part = np.arange(ROWS) % 8 + 1
    places = np.random.default_rng(0).uniform(-0.1, 0.1, (8, 3))[part - 1]
    values = {k: v for k, v in every_column(3).items() if k in columns}
    return Recording(
        name="head",
        observation="fiducials",
        robot=rig,
        chain=rig.chain(),
        tip_frame=rig.default_tip,
        q=places,
        measured=R_DEVICE_BASE.apply(places) + T_DEVICE_BASE,
        tool_offset=np.zeros(3),
        element=part,
        elements=tuple("12345678"),
        pitch=np.array([0.0, 0.0, 5e-3]),
        stand_in=True,
        always=("frame",),
        **values,
    )


def residuals(recording, effects=(), values=(), nuisance=None):
    """Residuals (N, m) with the effects' parameters at some values, nuisances at their start."""
    model = build_model(recording, effects, nuisance=nuisance)
    x = model.start.copy()
    x[model.fixed :] = values
    return Mapped(model.problem).residuals(x)

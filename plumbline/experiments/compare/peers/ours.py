"""Ours."""

from collections.abc import Mapping
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from plumbline.kinematics.effects import REGISTRY, Effect
from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.effects.actuation_offset import ActuationOffset
from plumbline.kinematics.frames import homogeneous
from plumbline.kinematics.law import Law
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.dh_fit import DHOptions, Readings, Squares, fit_dh
from plumbline.optim.diagnosis.motion.fit import evaluated, fitted
from plumbline.optim.diagnosis.motion.windows import Windows
from plumbline.optim.measurement.constants import UNIT
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model, scope_of
from plumbline.optim.measurement.refit import refit
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.recording import Recording
from plumbline.optim.registration import MarkerNoise, build_fiducials, register

Array = NDArray[np.float64]
PACKAGE = "plumbline-robotics"
TERMS = ("coulomb_friction", "viscous_friction", "rotor_inertia", "torque_scale", "torque_offset")
DRIVE = (ActuationOffset(), ActuationDelay(), ActuationLag())
TASKS, OBSTACLES, CHOSEN = 10, 3, 3  # of the course that is driven, and every so manieth programme


def registration(given: Mapping[str, Array]) -> Array:
    """Registrations ``T_RC`` (M, 4, 4) of M phantoms, moved markers found and left out."""
    std = float(given["noise_std"])
    noise = MarkerNoise.from_std(std, std)
    found = []
    for ct, robot in zip(given["ct"], given["robot"], strict=True):
        recording = build_fiducials(ct, robot, noise=noise)
        found.append(register(recording).T_RC)
    return np.array(found)


def hand_eye(given: Mapping[str, Array]) -> Array:
    """The tool in the flange ``T`` (M, 4, 4) [m] of M set-ups: what a diagnosis fits first."""
    return np.array([_tool(q, T) for q, T in zip(given["q"], given["seen"], strict=True)])


def _tool(q: Array, seen: Array) -> Array:
    turned = Rotation.from_matrix(seen[:, :3, :3]).as_quat(scalar_first=True)
    measured = np.column_stack([seen[:, :3, 3], turned])
    recording = build_recording(
        observation="pose",
        robot=Robot.bundled("ur5"),
        q=q,
        measured=measured,
        tool_offset=np.zeros(3),
    )
    solution = refit(recording, (), np.empty(0))
    n = nuisances_of(recording)
    made = cs.Function("tool", [n.x], [cs.densify(n.R_tip_tool), cs.densify(n.tool)])
    R, t = (part.full() for part in made.call([cs.DM(solution.x)]))
    return homogeneous(R, t.ravel() + recording.tool_offset)


def dh(given: Mapping[str, Array]) -> Any:
    """Links, frame and tool; loss the square as the others have it."""
    keys = ("d", "a", "alpha", "theta")
    rows = [dict(zip(keys, map(float, row), strict=True)) for row in given["dh"]]
    recording = build_recording(
        observation="tip_position", robot=Robot.from_dh(rows), q=given["q"],
        measured=given["tips"], tool_offset=given["tool"],
    )  # fmt: skip
    return fit_dh(recording, DHOptions(loss=Squares()))


def dh_misses(given: Mapping[str, Array], found: Any) -> Array:
    """Distances of tips on rows not fitted (N,) [m]."""
    return np.linalg.norm(found.misfits(Readings(given["q_new"], given["tips_new"])), axis=1)


def _recording(given: Mapping[str, Array], end: str) -> Recording:
    robot = Robot.from_urdf(str(given["urdf"]), gravity=given["gravity"])
    return build_recording(
        observation="joint_torque", robot=robot, q=given[f"q{end}"], velocity=given[f"v{end}"],
        acceleration=given[f"a{end}"], measured=given[f"tau{end}"],
        noise_by_joint=np.ones(given["q"].shape[1]), always=(),
    )  # fmt: skip


def _effects(recording: Recording) -> list[Effect]:
    scope = scope_of(recording)
    every = [e for name in TERMS for e in REGISTRY[name].candidates(scope)]
    return [e for e in every if not e.variant]


def torque(given: Mapping[str, Array]) -> Array:
    """Dry and viscous friction, rotor, scale and zero of the effort of every joint."""
    recording = _recording(given, "")
    effects = _effects(recording)
    nulls = np.array([p.null for e in effects for p in e.parameters])
    return np.asarray(refit(recording, effects, nulls, free=effects).x)


def torque_misses(given: Mapping[str, Array], found: Array) -> Array:
    """Efforts missed on rows not fitted [N m]."""
    model = build_model(_recording(given, "_new"), _effects(_recording(given, "")))
    return np.asarray(Mapped(model.problem).residuals(found) / UNIT)


def _windows(given: Mapping[str, Array], joint: int, starts: Array) -> Windows:
    u, q = given["u"][:, joint], given["q"][:, joint]
    nothing = np.zeros(len(q))
    return Windows(
        Law.POSITION, float(given["dt"]), 0.0, 0.0, u, np.zeros(len(q), np.int64), q,
        q, nothing, nothing, nothing, starts.astype(np.int64), int(given["length"]),
        int(given["settle"]),
    )  # fmt: skip


def motion(given: Mapping[str, Array]) -> list[Array]:
    """Offset, delay and lag (n, 3)."""
    joints = range(given["q"].shape[1])
    windows = [_windows(given, j, given["fit"]) for j in joints]
    return [fitted(one, DRIVE, given["start"]).theta for one in windows]


def motion_misses(given: Mapping[str, Array], found: list[Array]) -> Array:
    """Root mean squares on windows not fitted (n,) [rad]."""
    windows = [_windows(given, j, given["judge"]) for j in range(len(found))]
    pairs = zip(windows, found, strict=True)
    return np.sqrt([evaluated(one, DRIVE, theta).square for one, theta in pairs])


def raced() -> Any:
    """The banded solver and HPIPM on the same programmes of a course, in turns."""
    from plumbline.experiments.benches import mpc
    from plumbline.experiments.compare.hpipm import Recording as Programmes
    from plumbline.experiments.compare.hpipm import race
    from plumbline.optim.capsule_mpc import RealTime

    recorded = Programmes([])
    mpc.drive("recorded", RealTime(recorded, compiled=False), TASKS, OBSTACLES, 2, 100)
    found = race(recorded.kept[::CHOSEN])
    if found is None:
        raise ImportError("this CasADi brings no HPIPM")
    return found


def programme(given: Mapping[str, Array]) -> dict[str, float]:
    """Median and 99th percentile of one programme [ms], and how far the paths are apart [mm]."""
    found = raced()
    return {"error": found.banded[0], "p99": found.banded[1], "apart": found.apart}

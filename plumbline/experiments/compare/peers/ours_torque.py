"""Our fit of five terms a joint: dry and viscous friction, rotor, scale and zero of the effort."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version as version_of

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects import REGISTRY, Effect
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.measurement.observation import build_model, scope_of
from plumbline.optim.measurement.refit import refit
from plumbline.optim.measurement.torque import UNIT
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.recording import Recording

Array = NDArray[np.float64]
TERMS = ("coulomb_friction", "viscous_friction", "rotor_inertia", "torque_scale", "torque_offset")


def version() -> str:
    """Of plumbline."""
    return version_of("plumbline-robotics")


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
    return [e for e in every if getattr(e, "power", 1.0) == 1.0]


def fit(given: Mapping[str, Array]) -> Array:
    """All parameters."""
    recording = _recording(given, "")
    effects = _effects(recording)
    nulls = np.array([p.null for e in effects for p in e.parameters])
    return np.asarray(refit(recording, effects, nulls, free=effects).x)


def figures(given: Mapping[str, Array], found: Array) -> dict[str, float]:
    """RMS of the efforts on rows not fitted [N m]."""
    model = build_model(_recording(given, "_new"), _effects(_recording(given, "")))
    misses = Mapped(model.problem).residuals(found) / UNIT
    return {"error": float(np.sqrt(np.mean(misses**2)))}

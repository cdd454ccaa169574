"""Mechanisms outside the library, by someone who has not read the engine that is held against them.

Each is one class: its formula, where it is known from, and how it is drawn; on what it truly
depends stands in ``mechanisms.toml``. Their forms are not those of `outside_effects`, nor sums of
the library's.
"""

from collections.abc import Callable

import numpy as np

from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen import bodies, joints, places

__all__ = ["UNSEEN", "unseen_offered"]

OF_JOINTS = (
    joints.CableCreep, joints.EncoderInterpolation, joints.EndCushion, joints.FlexsplineLoad,
    joints.GearPit, joints.HubSlip, joints.LoadWindup, joints.MaxwellSlip, joints.MotorHeat,
    joints.WornBelt,
)  # fmt: skip
OF_BODIES = (
    bodies.BearingRunout, bodies.Draught, bodies.FloorSag, bodies.LooseBolt, bodies.ThermalBow,
    bodies.ToolRocking,
)  # fmt: skip
OF_PLACES = (
    places.FieldBody, places.HoseDrag, places.StitchedVolume, places.TrackerRefraction,
)  # fmt: skip

UNSEEN: dict[str, Callable[[Scene, np.random.Generator], Mechanism]] = {
    kind.effect: kind.drawn for kind in (*OF_JOINTS, *OF_BODIES, *OF_PLACES)
}


def unseen_offered(observation: str) -> tuple[str, ...]:
    """Names of the mechanisms that can show in an observation."""
    shown: tuple[type[Mechanism], ...] = (*OF_JOINTS, *OF_BODIES, *OF_PLACES)
    if observation == "joint_position":
        shown = tuple(kind for kind in shown if issubclass(kind, JointMechanism))
    elif observation == "fixed_point":
        shown = (*OF_JOINTS, *OF_BODIES)
    return tuple(kind.effect for kind in shown)

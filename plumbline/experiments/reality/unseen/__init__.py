"""Mechanisms outside the library, by someone who has not read the engine that is held against them.

Each file is one mechanism: its formula, where it is known from, how it is drawn, and on what it
truly depends. Their forms are not those of `outside_effects`, nor sums of the library's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen.bearing_runout import BearingRunout
from plumbline.experiments.reality.unseen.cable_creep import CableCreep
from plumbline.experiments.reality.unseen.draught import Draught
from plumbline.experiments.reality.unseen.encoder_interpolation import EncoderInterpolation
from plumbline.experiments.reality.unseen.end_cushion import EndCushion
from plumbline.experiments.reality.unseen.field_body import FieldBody
from plumbline.experiments.reality.unseen.flexspline_load import FlexsplineLoad
from plumbline.experiments.reality.unseen.floor_sag import FloorSag
from plumbline.experiments.reality.unseen.gear_pit import GearPit
from plumbline.experiments.reality.unseen.hose_drag import HoseDrag
from plumbline.experiments.reality.unseen.hub_slip import HubSlip
from plumbline.experiments.reality.unseen.load_windup import LoadWindup
from plumbline.experiments.reality.unseen.loose_bolt import LooseBolt
from plumbline.experiments.reality.unseen.maxwell_slip import MaxwellSlip
from plumbline.experiments.reality.unseen.motor_heat import MotorHeat
from plumbline.experiments.reality.unseen.stitched_volume import StitchedVolume
from plumbline.experiments.reality.unseen.thermal_bow import ThermalBow
from plumbline.experiments.reality.unseen.tool_rocking import ToolRocking
from plumbline.experiments.reality.unseen.tracker_refraction import TrackerRefraction
from plumbline.experiments.reality.unseen.worn_belt import WornBelt

__all__ = ["UNSEEN", "unseen_offered"]

OF_JOINTS = (
    CableCreep, EncoderInterpolation, EndCushion, FlexsplineLoad, GearPit, HubSlip, LoadWindup,
    MaxwellSlip, MotorHeat, WornBelt,
)  # fmt: skip
OF_BODIES = (BearingRunout, Draught, FloorSag, LooseBolt, ThermalBow, ToolRocking)
OF_PLACES = (FieldBody, HoseDrag, StitchedVolume, TrackerRefraction)  # alike in any one socket

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

"""The library of effects: one file an effect, one line here."""

from __future__ import annotations

from kinematics.effects.backlash import Backlash
from kinematics.effects.base_bump import BaseBump
from kinematics.effects.base_compliance import BaseCompliance
from kinematics.effects.base_drift import BaseDrift
from kinematics.effects.effect import Effect, Scope, Stage, State
from kinematics.effects.friction import Friction
from kinematics.effects.gear_ripple import GearRipple
from kinematics.effects.hysteresis import Hysteresis
from kinematics.effects.joint_compliance import JointCompliance
from kinematics.effects.joint_coupling import JointCoupling
from kinematics.effects.joint_offset import JointOffset
from kinematics.effects.joint_scale import JointScale
from kinematics.effects.latency import Latency
from kinematics.effects.link_flex import LinkFlex
from kinematics.effects.link_geometry import LinkGeometry
from kinematics.effects.link_thermal import LinkThermal
from kinematics.effects.needle_sag import NeedleSag
from kinematics.effects.payload import Payload
from kinematics.effects.respiration import Respiration
from kinematics.effects.sensor_distortion import SensorDistortion
from kinematics.effects.sensor_scale import SensorScale
from kinematics.effects.tool_offset import ToolOffset
from kinematics.effects.transmission_ripple import TransmissionRipple

EFFECTS: tuple[type[Effect], ...] = (
    LinkGeometry,
    JointOffset,
    JointScale,
    JointCompliance,
    Backlash,
    Hysteresis,
    Friction,
    TransmissionRipple,
    GearRipple,
    JointCoupling,
    LinkThermal,
    LinkFlex,
    BaseDrift,
    BaseBump,
    BaseCompliance,
    ToolOffset,
    NeedleSag,
    Payload,
    SensorScale,
    SensorDistortion,
    Latency,
    Respiration,
)

REGISTRY: dict[str, type[Effect]] = {effect.name: effect for effect in EFFECTS}

__all__ = ["EFFECTS", "REGISTRY", "Effect", "Scope", "Stage", "State"]

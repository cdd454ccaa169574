"""The library of effects: one file an effect, one line here."""

from plumbline.kinematics.effects.acceleration_limit import AccelerationLimit
from plumbline.kinematics.effects.actuation_deadband import ActuationDeadband
from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.kinematics.effects.actuation_gain import ActuationGain
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.effects.actuation_offset import ActuationOffset
from plumbline.kinematics.effects.actuation_play import ActuationPlay
from plumbline.kinematics.effects.backlash import Backlash
from plumbline.kinematics.effects.base_bump import BaseBump
from plumbline.kinematics.effects.base_compliance import BaseCompliance
from plumbline.kinematics.effects.base_drift import BaseDrift
from plumbline.kinematics.effects.cable_spring import CableSpring
from plumbline.kinematics.effects.coulomb_friction import CoulombFriction, CoulombFrictionOfMotion
from plumbline.kinematics.effects.coupled_play import CoupledPlay
from plumbline.kinematics.effects.ct_scale import CtScale
from plumbline.kinematics.effects.effect import Effect, Scope, Stage, State
from plumbline.kinematics.effects.friction import Friction
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.gravity_direction import GravityDirection
from plumbline.kinematics.effects.hysteresis import Hysteresis
from plumbline.kinematics.effects.incidence_bias import IncidenceBias
from plumbline.kinematics.effects.joint_compliance import JointCompliance
from plumbline.kinematics.effects.joint_coupling import JointCoupling
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.joint_scale import JointScale
from plumbline.kinematics.effects.joint_tilt import JointTilt
from plumbline.kinematics.effects.latency import Latency
from plumbline.kinematics.effects.link_flex import LinkFlex
from plumbline.kinematics.effects.link_geometry import LinkGeometry
from plumbline.kinematics.effects.link_inertia import LinkInertia
from plumbline.kinematics.effects.link_thermal import LinkThermal
from plumbline.kinematics.effects.load_friction import LoadFriction
from plumbline.kinematics.effects.marker_shift import MarkerShift
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.effects.needle_bending import NeedleBending
from plumbline.kinematics.effects.needle_sag import NeedleSag
from plumbline.kinematics.effects.payload import Payload
from plumbline.kinematics.effects.plane_unflatness import PlaneUnflatness
from plumbline.kinematics.effects.range_scale import RangeScale
from plumbline.kinematics.effects.respiration import Respiration
from plumbline.kinematics.effects.rotor_inertia import RotorInertia, RotorInertiaOfMotion
from plumbline.kinematics.effects.screw_ripple import ScrewRipple
from plumbline.kinematics.effects.sensor_distortion import SensorDistortion
from plumbline.kinematics.effects.sensor_scale import SensorScale
from plumbline.kinematics.effects.servo_bandwidth import ServoBandwidth
from plumbline.kinematics.effects.servo_stiffness import ServoStiffness
from plumbline.kinematics.effects.slice_quantisation import SliceQuantisation
from plumbline.kinematics.effects.stribeck_friction import StribeckFriction
from plumbline.kinematics.effects.tool_offset import ToolOffset
from plumbline.kinematics.effects.tool_slip import ToolSlip
from plumbline.kinematics.effects.torque_limit import TorqueLimit
from plumbline.kinematics.effects.torque_offset import TorqueOffset
from plumbline.kinematics.effects.torque_scale import TorqueScale
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.kinematics.effects.trocar_load import TrocarLoad
from plumbline.kinematics.effects.velocity_limit import VelocityLimit
from plumbline.kinematics.effects.viscous_friction import ViscousFriction, ViscousFrictionOfMotion

EFFECTS: tuple[type[Effect], ...] = (
    LinkGeometry,
    JointOffset,
    JointScale,
    JointCompliance,
    JointTilt,
    Backlash,
    Hysteresis,
    Friction,
    TransmissionRipple,
    GearRipple,
    ScrewRipple,
    JointCoupling,
    CoupledPlay,
    LinkThermal,
    LinkFlex,
    BaseDrift,
    BaseBump,
    BaseCompliance,
    ToolOffset,
    ToolSlip,
    NeedleSag,
    NeedleBending,
    Payload,
    SensorScale,
    SensorDistortion,
    Latency,
    Respiration,
    CoulombFriction,
    ViscousFriction,
    StribeckFriction,
    LoadFriction,
    RotorInertia,
    TorqueScale,
    TorqueOffset,
    LinkInertia,
    GravityDirection,
    CableSpring,
    TrocarLoad,
    RangeScale,
    IncidenceBias,
    PlaneUnflatness,
    MarkerShift,
    SliceQuantisation,
    CtScale,
)

REGISTRY: dict[str, type[Effect]] = {effect.name: effect for effect in EFFECTS}

# Of a drive, in the order in which its terms act: they have memory, and are rolled out.
MOTION_EFFECTS: tuple[type[MotionEffect], ...] = (
    ActuationGain,
    ActuationOffset,
    ActuationDelay,
    AccelerationLimit,
    ActuationDeadband,
    ActuationLag,
    ServoBandwidth,
    CoulombFrictionOfMotion,
    ViscousFrictionOfMotion,
    RotorInertiaOfMotion,
    VelocityLimit,
    TorqueLimit,
    ServoStiffness,
    ActuationPlay,
)

__all__ = [
    "EFFECTS",
    "MOTION_EFFECTS",
    "REGISTRY",
    "Effect",
    "MotionEffect",
    "Scope",
    "Stage",
    "State",
]

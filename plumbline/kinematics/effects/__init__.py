"""The library of effects: one file an effect, called like its class, and one name here."""

from importlib import import_module
from typing import Any

from plumbline.kinematics.effects.effect import Effect as Effect
from plumbline.kinematics.effects.effect import Scope as Scope
from plumbline.kinematics.effects.effect import Stage as Stage
from plumbline.kinematics.effects.effect import State as State
from plumbline.kinematics.effects.motion_effect import MotionEffect as MotionEffect

LISTED = (
    "link_geometry joint_offset joint_scale joint_compliance joint_tilt backlash hysteresis "
    "friction transmission_ripple gear_ripple screw_ripple joint_coupling coupled_play "
    "link_thermal link_flex base_drift base_bump base_compliance tool_offset tool_slip "
    "needle_sag needle_bending payload sensor_scale sensor_distortion latency respiration "
    "coulomb_friction viscous_friction stribeck_friction load_friction rotor_inertia "
    "torque_scale torque_offset link_inertia gravity_direction cable_spring trocar_load "
    "range_scale incidence_bias plane_unflatness marker_shift slice_quantisation ct_scale"
)
# Of a drive, in the order in which its terms act: they have memory, and are rolled out.
OF_DRIVES = (
    "actuation_gain actuation_offset actuation_delay acceleration_limit actuation_deadband "
    "actuation_lag servo_bandwidth coulomb_friction viscous_friction rotor_inertia "
    "velocity_limit torque_limit servo_stiffness actuation_play"
)


def _classes(names: str, ending: str = "") -> Any:
    """``JointOffset`` of ``joint_offset.py``, or the file's class for motions, by its ending."""
    files = {name: import_module(f"{__name__}.{name}") for name in names.split()}
    called = {name: "".join(map(str.capitalize, name.split("_"))) for name in files}
    return tuple(
        getattr(file, called[name] + ending, None) or getattr(file, called[name])
        for name, file in files.items()
    )


EFFECTS: tuple[type[Effect], ...] = _classes(LISTED)
MOTION_EFFECTS: tuple[type[MotionEffect], ...] = _classes(OF_DRIVES, "OfMotion")
REGISTRY: dict[str, type[Effect]] = {effect.name: effect for effect in EFFECTS}

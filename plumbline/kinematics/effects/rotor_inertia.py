r"""The motor's rotor, which the model's links lack: a flywheel behind the gear.

.. math:: \tau_i \leftarrow \tau_i + I\,\ddot q_i

with the rotor's inertia times the gear's ratio squared. MuJoCo calls it armature.
In a motion it is as much more to be moved.
"""

from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.drive import DriveEffect
from plumbline.kinematics.effects.effect import State
from plumbline.kinematics.effects.motion_effect import INERT, MotionEffect
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class RotorInertia(DriveEffect):
    """Torque in proportion to the joint's own acceleration."""

    depends_on = "acceleration"
    name = "rotor_inertia"
    words = "joint {element}'s motor has a rotor that the model does not know of"
    reference = "Featherstone (2008), Rigid Body Dynamics Algorithms, sec. 9.6 (gears, rotors)"
    source = (
        "makers' data of servo motors, 1e-6 to 1e-4 kg m^2 behind gears of 50 to 160: up to 2.6 "
        "kg m^2 where the largest torque is some 300 N m, of which a gentle log holds a tenth"
    )
    inertia = Parameter("kg m^2", 0.0, 10.0, scale=0.1, doc="rotor's inertia on the joint's side")

    def apply(self, state: State, *values: cs.SX) -> State:
        return state.add_torque(self.joint, values[0] * state.row["acceleration"][self.joint - 1])


@dataclass(frozen=True)
class RotorInertiaOfMotion(MotionEffect, of=RotorInertia):
    """A flywheel that torques and servos of known gains have to move as well."""

    term = "rotor"
    laws = INERT
    needs_masses = True
    inertia = Parameter("kg m^2", 0.0, 10.0, scale=0.02, doc="rotor's inertia on the joint's side")

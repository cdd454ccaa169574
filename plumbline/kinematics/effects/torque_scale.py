r"""A motor constant or a torque sensor's gain that is not what is stated.

.. math:: \tau_i^{read} \leftarrow \tau_i^{read} + s\,\tau_i(q, \dot q, \ddot q)

on the torque that moves the bodies. Friction is scaled as well, and is told as it is read: whether
the drive rubs more or reads more is one and the same, so nothing is lost by leaving it out.
"""

from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.drive import DriveEffect
from plumbline.kinematics.effects.effect import State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class TorqueScale(DriveEffect):
    """The bodies' torque read by another factor than one."""

    depends_on = "load"
    name = "torque_scale"
    words = "joint {element}'s efforts are read on another scale than stated"
    reference = "Gautier, Briot (2014), ASME J. Dyn. Sys. Meas. Control 136(5) (drive gains)"
    source = "by hand: torque constants are stated to five or ten per cent"
    in_load = False
    scale = Parameter("1", -0.9, 3.0, scale=0.05, doc="how much more is read than there is")

    def apply(self, state: State, *values: cs.SX) -> State:
        return state.add_torque(self.joint, values[0] * state.carried[self.joint - 1])

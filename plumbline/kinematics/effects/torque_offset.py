r"""A reading of torque that is off by a constant: a sensor's zero, an amplifier's bias.

.. math:: \tau_i \leftarrow \tau_i + o
"""

from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.drive import DriveEffect
from plumbline.kinematics.effects.effect import State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class TorqueOffset(DriveEffect):
    """A constant on the effort of one joint."""

    depends_on = "nothing"
    name = "torque_offset"
    words = "joint {element}'s efforts are off by a constant"
    reference = "Swevers, Verdonck, De Schutter (2007), IEEE Control Systems 27(5) (offsets)"
    source = "by hand: zeros of torque sensors and currents, below a per cent of their range"
    offset = Parameter("N m", -5.0, 5.0, scale=0.05, doc="constant on the effort")

    def apply(self, state: State, *values: cs.SX) -> State:
        return state.add_torque(self.joint, values[0])

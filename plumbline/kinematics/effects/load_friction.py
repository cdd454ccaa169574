r"""Friction of a gear that grows with what its teeth transmit.

.. math:: \tau_i \leftarrow \tau_i + \mu\,|\tau_{i}(q, \dot q, \ddot q)|\,\sigma(\dot q_i)

with the torque that moving the bodies takes: worm and planetary gears, and strain-wave gears under
a heavy load, lose a share of what passes through them.
"""

from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.drive import DriveEffect
from plumbline.kinematics.effects.effect import State
from plumbline.kinematics.parameters import Parameter

ROUND = 1e-9  # N m: where the size of a torque has no slope


@dataclass(frozen=True)
class LoadFriction(DriveEffect):
    """Friction in proportion to the load."""

    depends_on = "load"
    name = "load_friction"
    words = "joint {element}'s gear loses a share of the torque that passes through it"
    reference = "Hamon, Gautier, Garrec (2010), IEEE/RSJ IROS (dry friction with load)"
    source = "makers' efficiencies of strain-wave gears, 70 to 90 %, that friction takes a part of"
    in_load = False
    share = Parameter("1", 0.0, 1.0, scale=0.05, doc="share of the load that friction takes")

    def apply(self, state: State, *values: cs.SX) -> State:
        i = self.joint - 1
        size = cs.sqrt(state.carried[i] ** 2 + ROUND**2)
        return state.add_torque(self.joint, values[0] * size * state.row["turning"][i])

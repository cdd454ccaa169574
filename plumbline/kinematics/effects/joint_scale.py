r"""The encoder's gain is wrong: :math:`q_i \leftarrow (1 + k_i)\, q_i`."""

from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.effect import JointEffect, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class JointScale(JointEffect):
    """A gain error of one joint: a wrong gear ratio, a stretched tape, a slipping belt."""

    depends_on = "own angle"
    name = "joint_scale"
    words = "joint {element} moves more or less than it says, in proportion"
    reference = "Whitney, Lozinski, Rourke (1986), J. Dyn. Sys. Meas. Control 108, sec. 3"
    source = (
        "width by hand: a tape or belt stretched by half a permille; range: cables that give way "
        "and wheels of another radius, three tenths at the most"
    )
    gain = Parameter("1", -0.3, 0.3, scale=5e-4, doc="relative error of travel")

    def apply(self, state: State, *values: cs.SX) -> State:
        return state.move_joint(self.joint, values[0] * state.reading_of_joint(self.joint))

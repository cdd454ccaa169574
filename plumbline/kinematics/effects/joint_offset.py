r"""The encoder's zero is not where the model has it: :math:`q_i \leftarrow q_i + \delta_i`.

Of a second encoder on the link's side it is the difference of the two zeros.
"""

from dataclasses import dataclass

import casadi as cs
import numpy as np

from plumbline.kinematics.effects.effect import JointEffect, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class JointOffset(JointEffect):
    """A constant error of one joint's zero."""

    depends_on = "own angle"
    name = "joint_offset"
    words = "joint {element}'s zero is off"
    reference = "Mooring, Roth, Driels (1991), Fundamentals of Manipulator Calibration, ch. 2"
    source = (
        "width by hand: a zero set at a mark; range: wrists on cables, whose zeros are off by "
        "tenths of a radian (Hwang et al. 2020, IEEE RA-L 5(4)), and second encoders, mounted at "
        "any angle of a turn"
    )
    offset = Parameter("rad", -np.pi, np.pi, scale=1e-3, doc="error of the zero")

    def apply(self, state: State, *values: cs.SX) -> State:
        return state.move_joint(self.joint, values[0])

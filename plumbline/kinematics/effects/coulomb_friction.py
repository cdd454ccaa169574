r"""Dry friction of a drive: as much torque more, whichever way it turns.

.. math:: \tau_i \leftarrow \tau_i + c\,\sigma(\dot q_i)

:math:`\sigma` is the sign of the velocity, softened where the velocity is not surely one or the
other: the reading of a joint that stands still does not say which way friction holds it.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.drive import DriveEffect
from plumbline.kinematics.effects.effect import State
from plumbline.kinematics.parameters import Parameter

SOURCE = "by hand: some per cent of the rated torque of drives of 3 to 20 kg of payload"


@dataclass(frozen=True)
class CoulombFriction(DriveEffect):
    """Friction that does not depend on the speed."""

    depends_on = "velocity"
    name = "coulomb_friction"
    words = "joint {element}'s drive works against dry friction"
    reference = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), sec. 2"
    dry = Parameter("N m", 0.0, 5.0, scale=0.1, source=SOURCE, doc="dry friction")

    def apply(self, state: State, *values: cs.SX) -> State:
        """Exert it with the motion."""
        return state.add_torque(self.joint, values[0] * state.row["turning"][self.joint - 1])

r"""A mass at the tip that the controller does not know of.

.. math:: q \leftarrow q - c_0\, (\tau(q, m) - \tau(q, 0))

Every drive twists under the added torque. What a recording shows is the product of mass and
compliance; the mass quoted is that for drives of the nominal compliance :math:`c_0` = 5e-6
rad/(N m), that of a light six-joint arm (Dumas et al. 2011, table 4, scaled).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as cs

from kinematics.effects.effect import ALL_OBSERVATIONS, Effect, Scope, Stage, State
from kinematics.parameters import Parameter

NOMINAL_COMPLIANCE = 5e-6


@dataclass(frozen=True)
class Payload(Effect):
    """An unknown mass at the tip, felt through all drives at once."""

    name = "payload"
    stage = Stage.TOOL
    acts_at = Stage.JOINT
    observations = ALL_OBSERVATIONS
    words = "the arm carries a mass at its tip that the model does not know of"
    reference = "Dumas et al. (2011), Robotics and Computer-Integrated Manufacturing 27(4), eq. 9"
    mass = Parameter("kg", 0.0, 200.0, scale=2.0, doc="unknown mass, for drives of 5e-6 rad/(N m)")

    @classmethod
    def fits(cls, scope: Scope) -> bool:
        """Only where there is gravity."""
        return super().fits(scope) and bool(scope.chain.gravity.any())

    def apply(self, state: State, *values: cs.SX) -> State:
        """Twist every revolute joint under the torque of the mass."""
        q = state.row["q"]
        empty, laden = (state.chain.gravity_torque(q, mass) for mass in (cs.SX(0), values[0]))
        turning = cs.vertcat(*[float(kind == "revolute") for kind in state.chain.kinds])
        return replace(state, q=state.q - NOMINAL_COMPLIANCE * turning * (laden - empty))

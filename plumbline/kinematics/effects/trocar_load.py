r"""What a trocar does to the shaft that runs through it: friction, and a steady push.

.. math:: \tau \leftarrow \tau + c\,\sigma(s)\, J_p^T a + J_p^T f + J_w^T (m - p \times f),
          \qquad s = a^T J_p\, \dot q

a is the shaft's direction, from the tip frame to the tool's tip, and p the tip frame's origin.
Friction acts along the shaft, so that no one need know where the trocar is. A steady force through
a trocar at x is a force f and a moment :math:`m = x \times f` about the base's origin, which do not
change while the arm moves; what is quoted is what the drives exert against them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects.drive import TORQUES
from plumbline.kinematics.effects.effect import UNSAID, Effect, Scope, Stage, State
from plumbline.kinematics.effects.needle_sag import axis_of
from plumbline.kinematics.frames import constant
from plumbline.kinematics.parameters import Parameter

SHORTEST_SHAFT = 0.1  # m: no instrument that reaches through a wall of the body is shorter
CREEPING = 1e-3  # m/s: slower than surgeons move; the sign of the sliding is softened below

OF_SEALS = "six trocars and dry or moist shafts, 0.25 to 3 N; the bound is the driest that jams"


@dataclass(frozen=True)
class TrocarLoad(Effect):
    """Friction along the shaft and a wrench that stays in the base frame."""

    axis: tuple[float, float, float] = field(default=(0.0, 0.0, 1.0), metadata=UNSAID)

    name = "trocar_load"
    stage = Stage.ACTUATION
    depends_on = "velocity"
    observations = TORQUES
    words = "the trocar rubs on the instrument's shaft and pushes it aside"
    reference = "van den Dobbelsteen, Schooleman, Dankelman (2007), Surgical Endoscopy 21"
    source = (
        "by hand: a body's wall that is pushed aside by some newtons, half a metre from the base"
    )
    friction = Parameter("N", 0.0, 50.0, scale=1.0, source=OF_SEALS, doc="friction on the shaft")
    x, y, z = Parameter("N", -100.0, 100.0, 3.0, doc="force along the base's {}").each(*"xyz")
    about_x, about_y, about_z = Parameter(
        "N m", -50.0, 50.0, scale=1.5, doc="moment about base {}"
    ).each(*"xyz")

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """One, where the recording states a tool as long as an instrument's shaft."""
        return [cls(axis_of(scope))] if np.linalg.norm(scope.tool) >= SHORTEST_SHAFT else []

    def apply(self, state: State, *values: cs.SX) -> State:
        """Exert it with all drives that move the shaft."""
        q, T = state.row["q"], state.nominal.frames[-1]
        shaft, Jp = T.R @ constant(self.axis), cs.jacobian(T.t, q)
        slide = cs.dot(shaft, Jp @ state.row["velocity"])
        rubs = values[0] * slide / cs.sqrt(slide**2 + CREEPING**2) * shaft
        force, moment = cs.vertcat(*values[1:4]), cs.vertcat(*values[4:])
        about_tip = moment - cs.cross(T.t, force)
        # Power of a moment m: half of the sum of (m x e) . de over the columns e of T.R.
        by_turns = cs.jacobian(cs.vec(T.R), q).T @ cs.vec(cs.skew(about_tip) @ T.R) / 2
        exerted = Jp.T @ (rubs + force) + by_turns
        return replace(state, torque=state.torque + exerted)

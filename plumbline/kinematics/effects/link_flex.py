r"""A link bends sideways under what it carries and under its own weight, as a cantilever.

.. math:: \delta = \kappa\,(F_\perp L^3/3 + M \times u\, L^2/2 + w_\perp L^3/8), \qquad
          \varphi = \kappa\,(u \times F L^2/2 + M_\perp L + u \times w\, L^2/6)

for a beam of length L along u, with F and M the force and moment of all bodies beyond its end,
w its own weight and :math:`\kappa = 1/(E I)` (Timoshenko 1955, Strength of Materials I, ch. 5); or
of bodies that do not weigh what the model says, by their own shares
(:mod:`plumbline.kinematics.weights`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics import weights
from plumbline.kinematics.dynamics import weight_beyond
from plumbline.kinematics.effects.effect import UNSAID, Effect, Scope, Stage, State
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.frames import Transform, constant
from plumbline.kinematics.parameters import Parameter

SHORTEST = 0.05


@dataclass(frozen=True)
class LinkFlex(Effect):
    """Lateral bending of one link under gravity."""

    link: int = 1
    load: float = field(default=100.0, metadata=UNSAID)
    bodies: weights.Bodies = field(default=(), metadata=UNSAID)
    found: tuple[float, ...] = field(default=(), metadata=UNSAID)

    name = "link_flex"
    stage = Stage.LINK
    depends_on = "load"
    needs_gravity = True
    words = "link {element} bends under the weight that it carries"
    reference = "Timoshenko (1955), Strength of Materials I, ch. 5"
    source = (
        "by hand: E I of aluminium tubes 60 to 150 mm wide, 1e4 to 1e6 N m^2, and the usual one's "
        "between; the bound is a plastic rod's"
    )
    compliance = Parameter("1/(N m^2)", 0.0, 1e-2, scale=1e-5, doc="inverse bending stiffness")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """In units of what links of this load have: they are made for their load."""
        own = (self.compliance.of_width(100.0 / self.load),)
        return weights.with_shares(own, self.found, sum(self.found), self.bodies)

    @property
    def variant(self) -> str:
        """Whether the model's masses are taken as they are."""
        return weights.REWEIGHED[2:] * bool(self.bodies)

    def deviations(self, scope: Scope, values: Sequence[float]) -> Sequence[Effect]:
        """The same link under bodies of other weights."""
        bodies = weights.bodies_beyond(scope.chain, self.link) if values[0] > 0.0 else ()
        return [replace(self, bodies=bodies, found=tuple(values))] if bodies else []

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every link longer than 5 cm that carries something or weighs something."""
        long = [i for i in scope.joints if np.linalg.norm(_beam(scope, i)) > SHORTEST]
        return [cls(i, scope.chain.typical_load(i)) for i in long]

    def apply(self, state: State, *values: cs.SX) -> State:
        beam = state.chain.placements[self.link].t
        length = cs.norm_2(beam)
        u = beam / length
        frame = state.nominal.frames[self.link - 1]
        by = weights.shares(state.chain, self.bodies, values[1:], values[0])
        outer = weight_beyond(state.nominal, self.link + 1, frame.point(beam), by)
        own_mass = state.chain.joints[self.link - 1].mass * by[self.link - 1]
        weight = own_mass * constant(state.chain.gravity)
        force, moment, own = (frame.R.T @ v for v in (*outer, weight))
        f, m, w = (v - u * cs.dot(u, v) for v in (force, moment, own))
        shift = f * length**3 / 3 + cs.cross(m, u) * length**2 / 2 + w * length**3 / 8
        turn = cs.cross(u, f) * length**2 / 2 + m * length + cs.cross(u, w) * length**2 / 6
        bent = Transform(cs.SX.eye(3), state.placements[self.link].t + shift)
        tilt = Transform.from_twist(cs.SX(3, 1), turn)
        rest = Transform(state.placements[self.link].R, cs.SX(3, 1))
        return state.place_link(self.link, bent @ tilt @ rest)


def _beam(scope: Scope, link: int) -> Array:
    joints = scope.chain.joints
    T = joints[link].T_parent_joint if link < len(joints) else scope.chain.T_last_tip
    return np.asarray(T[:3, 3])

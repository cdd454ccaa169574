r"""The base tilts under the overturning moment of the arm's weight.

.. math:: T_{world,base} \leftarrow T_{world,base}\, \exp(0,\ (c_x M_x,\ c_y M_y,\ 0)), \qquad
          M = \sum_i p_i \times m_i g

or with bodies that do not weigh what the model says, by their own shares
(:mod:`plumbline.kinematics.weights`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs

from plumbline.kinematics import weights
from plumbline.kinematics.dynamics import weight_beyond
from plumbline.kinematics.effects.effect import UNSAID, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class BaseCompliance(Effect):
    """A mounting that yields about the base's x and y, alike or each in its own way."""

    alike: bool = True
    load: float = field(default=1000.0, metadata=UNSAID)
    bodies: weights.Bodies = field(default=(), metadata=UNSAID)
    found: tuple[float, ...] = field(default=(), metadata=UNSAID)

    name = "base_compliance"
    depends_on = "load"
    stage = Stage.BASE
    needs_gravity = True
    words = "the base, or an upright first bearing, tilts under the arm's own weight"
    reference = "Dumas et al. (2011), Robotics and Computer-Integrated Manufacturing 27(4), eq. 4"
    source = (
        "width by hand: 2 mrad under the 1 kN m of an arm that carries 100 kg; the bound is a foot "
        "of rubber"
    )
    about_x = Parameter("rad/(N m)", 0.0, 1e-2, scale=2e-6, doc="tilt about x per moment")
    about_y = Parameter("rad/(N m)", 0.0, 1e-2, scale=2e-6, doc="tilt about y per moment")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """One number where both directions yield alike, as wide as the arm is light."""
        found = self.declared[:1] if self.alike else self.declared
        own = tuple(p.of_width(1000.0 / self.load) for p in found)
        return weights.with_shares(own, self.found, sum(self.found) / len(own), self.bodies)

    @property
    def variant(self) -> str:
        """Whether it yields alike, and the model's masses are taken as they are."""
        return (
            "not alike" * (not self.alike) + weights.REWEIGHED * bool(self.bodies)
        ).removeprefix(", ")

    def deviations(self, scope: Scope, values: Sequence[float]) -> Sequence[Effect]:
        """The same mounting, or one that need not yield alike, under bodies of other weights."""
        bodies = weights.bodies_beyond(scope.chain, 1)
        if not bodies or not min(values) > 0.0:
            return []
        uneven = replace(self, alike=False, bodies=bodies, found=(values[0], values[-1]))
        return [uneven, replace(uneven, alike=True, found=(values[0],))][: 1 + self.alike]

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Both kinds."""
        return [cls(alike, scope.chain.typical_load(1)) for alike in (True, False)]

    def apply(self, state: State, *values: cs.SX) -> State:
        _, moment = weight_beyond(state.nominal, 1, cs.SX(3, 1))
        about = 1 if self.alike else 2
        own = weights.shares(state.chain, self.bodies, values[about:])
        _, other = weight_beyond(state.nominal, 1, cs.SX(3, 1), own)
        about_x, about_y = values[0] * moment[0], values[about - 1] * moment[1]
        tilt = cs.vertcat(about_x + other[0], about_y + other[1], 0)
        return state.move_base(cs.SX(3, 1), tilt)

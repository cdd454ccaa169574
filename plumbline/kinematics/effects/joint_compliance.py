r"""A drive gives way under its load: :math:`q_i \leftarrow q_i - c_i\, \tau_i`.

:math:`\tau_i` is the torque that the drive holds against gravity, the gradient of the potential
energy, or the measured effort where the recording has it. c is the inverse of the stiffness. A
drive that stiffens, as strain-wave gears do (Tuttle and Seering 1996, IEEE Trans. Robotics and
Automation 12(3)), twists by :math:`c_i \tau_i - k_i \tau_i |\tau_i|`, or, as any spring that is
softest about no load, by :math:`c_i \tau_i + b_i \tanh (\tau_i / w_i)`: of a load alone it cannot
be told from one that has play as well. One that carries a tool of unknown mass m twists besides by
:math:`c_i \tau_i + d_i \tau_{i,1}`, where a kilogram at the tool's middle asks for
:math:`\tau_{i,1}` and :math:`d_i = c_i m`; one of bodies that do not weigh what the model says by
their own shares (:mod:`plumbline.kinematics.weights`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs

from plumbline.kinematics import weights
from plumbline.kinematics.effects.effect import (
    UNSAID,
    Effect,
    JointEffect,
    Scope,
    State,
)
from plumbline.kinematics.parameters import Parameter

# Of a joint's largest load: from where a play is seated to a third, beyond which it is stiffening.
SOFT = (0.03, 0.09, 0.27)


@dataclass(frozen=True)
class JointCompliance(JointEffect):
    """Torsion of one drive under its load, in proportion or less and less."""

    effort: bool = False
    stiffening: bool = False
    laden: bool = False
    windup: float = field(default=0.0, metadata={"unit": "N m"})
    load: float = 100.0
    bodies: weights.Bodies = field(default=(), metadata=UNSAID)
    found: tuple[float, ...] = field(default=(), metadata=UNSAID)

    depends_on = "load"
    name = "joint_compliance"
    words = "joint {element}'s drive twists under its load"
    reference = "Spong (1987), J. Dyn. Sys. Meas. Control 109, eq. 9"
    source = (
        "makers' torsional stiffnesses of strain-wave gears, 5e3 to 5e5 N m/rad; the bound is a "
        "rubber belt's, by hand"
    )
    compliance = Parameter("rad/(N m)", 0.0, 1e-1, scale=5e-6, doc="twist per load torque")
    fall = Parameter("rad/(N m)^2", 0.0, 1e-3, scale=1e-8, doc="fall of the compliance per torque")
    soft = Parameter("rad", 0.0, 0.175, scale=2.5e-4, doc="twist of its windup")
    carried = weights.CARRIED

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """In units of what drives of this load have; one of a plain drive.

        Drives are made for their load, so that all of them twist by about as much under it.
        """
        smaller = 100.0 / self.load
        fall, carried = self.fall.of_width(smaller**2), self.carried.of_width(smaller)
        more = (fall,) * self.stiffening + (carried,) * self.laden
        more += (self.soft,) * bool(self.windup)
        own = (self.compliance.of_width(smaller), *more)
        return weights.with_shares(own, self.found, sum(self.found[:1]), self.bodies)

    @property
    def variant(self) -> str:
        """What is taken for the load, and whether the drive stiffens or carries a tool."""
        source = "by the measured effort" if self.effort else "by gravity"
        soft = f", softer within {self.windup:.2g} N m" if self.windup else ""
        other = weights.REWEIGHED * bool(self.bodies)
        return source + ", stiffening" * self.stiffening + weights.LADEN * self.laden + soft + other

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """By gravity where there is gravity; by measured effort where it was recorded."""
        sources = [True] * scope.has("effort") + [False] * bool(scope.chain.gravity.any())
        loads = [(j, scope.chain.typical_load(j)) for j in scope.joints]
        return [cls(j, effort, load=load) for j, load in loads for effort in sources]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """The same drive, stiffening, wound up or, where no effort tells, under an unknown tool."""
        if self.stiffening or self.laden or self.windup or self.bodies:
            return []
        laden = [] if self.effort else [replace(self, laden=True)]
        by = "effort" if self.effort else "load"
        parts = SOFT if scope.changes_sign(by, self.joint) else ()
        most = max(map(abs, scope.span.get(f"{by}{self.joint}", (0.0,))))
        wound = [replace(self, windup=part * most) for part in parts]
        return [replace(self, stiffening=True), *laden, *wound]

    def deviations(self, scope: Scope, values: Sequence[float]) -> Sequence[Effect]:
        """The same drive, or one that stiffens, under bodies of other weights."""
        bodies = weights.bodies_beyond(scope.chain, self.joint)
        if self.effort or not bodies or not values[0] > 0.0:
            return []
        own = replace(self, bodies=bodies, found=tuple(values))
        plain = not (self.stiffening or self.laden or self.windup)
        return [own, replace(own, stiffening=True, found=(*values, 0.0))] if plain else [own]

    def apply(self, state: State, *values: cs.SX) -> State:
        load = state.row["effort"] if self.effort else state.nominal.load
        torque = load[self.joint - 1]
        twist = values[0] * torque
        if self.stiffening:
            twist -= values[1] * torque * cs.fabs(torque)
        if self.windup:
            twist += values[1] * cs.tanh(torque / self.windup)
        if self.laden:
            twist += values[1] * state.nominal.load_at(state.middle)[self.joint - 1]
        if self.bodies:
            own = weights.shares(state.chain, self.bodies, values[-len(self.bodies) :])
            twist += state.nominal.load_of(own)[self.joint - 1]
        return state.move_joint(self.joint, -twist)

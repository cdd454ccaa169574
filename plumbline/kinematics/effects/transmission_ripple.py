r"""Once- or twice-per-turn error of a joint's transmission: an eccentric wheel, an oval one.

.. math:: q_i \leftarrow q_i + a \sin N q_i + b \cos N q_i, \qquad N = 1, 2

(a, b) rather than (amplitude, phase): a phase is undetermined at zero amplitude.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.effect import Effect, JointEffect, Scope, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class TransmissionRipple(JointEffect):
    """A slow periodic error of one joint."""

    order: float = 1
    doubled: bool = False

    depends_on = "own angle"
    name = "transmission_ripple"
    words = "joint {element} errs once or twice per turn, as an eccentric wheel or encoder does"
    reference = "Landgraf et al. (2021), IEEE CASE, doi 10.1109/CASE49439.2021.9551684"
    source = "eccentric rings and wheels of 0.02 to 0.1 mm on 50 to 100 mm; the bound by hand"
    sine = Parameter("rad", -2e-2, 2e-2, scale=5e-4, doc="in phase with q")
    cosine = Parameter("rad", -2e-2, 2e-2, scale=5e-4, doc="in quadrature")
    sine_twice = Parameter("rad", -2e-2, 2e-2, scale=5e-4, doc="at twice the order, in phase")
    cosine_twice = Parameter("rad", -2e-2, 2e-2, scale=5e-4, doc="twice the order, in quadrature")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Two numbers an order."""
        return self.declared if self.doubled else self.declared[:2]

    @property
    def variant(self) -> str:
        """The order, or both."""
        if self.doubled:
            return f"orders {self.order:g} and {2 * self.order:g}"
        return f"order {round(float(self.order), 2):g}"

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Orders 1 and 2 of every revolute joint, and both together."""
        kinds = ((1, False), (2, False), (1, True))
        return [cls(j, order, both) for j in scope.turning for order, both in kinds]

    def apply(self, state: State, *values: cs.SX) -> State:
        phase = self.order * state.reading_of_joint(self.joint)
        for k in range(len(values) // 2):
            turn = (k + 1) * phase if k else phase
            ripple = values[2 * k] * cs.sin(turn) + values[2 * k + 1] * cs.cos(turn)
            state = state.move_joint(self.joint, ripple)
        return state

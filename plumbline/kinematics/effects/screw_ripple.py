r"""A joint that slides errs once a turn of its screw, pinion or capstan.

.. math:: q_i \leftarrow q_i + a \sin (2 \pi q_i / h) + b \cos (2 \pi q_i / h)

with the lead h, found from the data by a scan: an eccentric nut, a bent screw, a belt's wheel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.constants import FINER
from plumbline.kinematics.effects.effect import Effect, JointEffect, Scope, State
from plumbline.kinematics.parameters import Parameter

LEAST_LEAD = 1e-3  # [m]: of the finest ball screws
WAVES = 1.5  # over the recorded way at least: one wave or less looks like a scale that is off


@dataclass(frozen=True)
class ScrewRipple(JointEffect):
    """One order of a sliding joint's periodic error."""

    order: float = 2.0 * np.pi / 4e-3  # of its angle to its way [rad/m]

    depends_on = "own angle"
    name = "screw_ripple"
    scanned = "order"
    of_slides = True
    words = "joint {element} errs once per turn of what drives it along, as an eccentric screw does"
    reference = "ISO 3408-3 (2006), ball screws: variation of travel within one revolution"
    source = (
        "width: eccentric wheels of 0.02 to 0.1 mm, as of joints that turn; ground screws keep to "
        "6 to 30 um (ISO classes 1 to 7); the bound by hand"
    )
    sine = Parameter("m", -2e-3, 2e-3, scale=1e-4, doc="in phase with q")
    cosine = Parameter("m", -2e-3, 2e-3, scale=1e-4, doc="in quadrature")

    @property
    def variant(self) -> str:
        """The lead."""
        return f"lead {2e3 * np.pi / float(self.order):.3g} mm"

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Leads half a wave over the way apart, of every joint that slides."""
        ways = {j: float(np.ptp(scope.span[f"q{j}"])) for j in scope.joints}
        return [
            cls(j, float(order))
            for j, way in ways.items()
            if j not in scope.turning and way > WAVES * LEAST_LEAD
            for order in np.arange(WAVES * 2.0 * np.pi / way, 2.0 * np.pi / LEAST_LEAD, np.pi / way)
        ]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Leads between those of the scan, the finest as near as 1/16 radian over the way."""
        low, high = scope.span[f"q{self.joint}"]
        near = [self.order + 2.0 * k / (high - low) for k in FINER]
        return [replace(self, order=float(order)) for order in near]

    def apply(self, state: State, *values: cs.SX) -> State:
        phase = self.order * state.reading_of_joint(self.joint)
        return state.move_joint(self.joint, values[0] * cs.sin(phase) + values[1] * cs.cos(phase))

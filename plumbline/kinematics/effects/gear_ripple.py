r"""Fast periodic error of a gear: teeth, a wave generator, a motor's own turn.

.. math:: q_i \leftarrow q_i + a \sin N q_i + b \cos N q_i, \qquad N > 2

The order N is found from the data by a scan over all of them, alone or with its overtone 2 N, as
teeth have it that are no sines. Many orders of one joint are one cause: a strain-wave gear shows
dozens.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plumbline.kinematics.effects.effect import Effect, Scope
from plumbline.kinematics.effects.transmission_ripple import TransmissionRipple
from plumbline.kinematics.parameters import Parameter

MAX_ORDER = 250


@dataclass(frozen=True)
class GearRipple(TransmissionRipple):
    """One order of a gear's periodic error."""

    order: float = 3

    depends_on = "own angle"
    name = "gear_ripple"
    scanned = "order"
    words = "joint {element}'s gear errs periodically, many times per turn"
    reference = "Tuttle and Seering (1996), IEEE Trans. Robotics and Automation 12(3), eq. 2"
    source = (
        "makers of strain-wave gears state a positional accuracy of 0.5 to 1.5 arc minutes; bound "
        "by hand"
    )
    sine = Parameter("rad", -1e-2, 1e-2, scale=2e-4, doc="in phase with q")
    cosine = Parameter("rad", -1e-2, 1e-2, scale=2e-4, doc="in quadrature")
    sine_twice = Parameter("rad", -1e-2, 1e-2, scale=2e-4, doc="at twice the order, in phase")
    cosine_twice = Parameter("rad", -1e-2, 1e-2, scale=2e-4, doc="twice the order, in quadrature")

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every whole order above two of every revolute joint that turns far enough to show it."""
        travel = {j: float(np.ptp(scope.span[f"q{j}"])) for j in scope.turning}
        orders = range(3, MAX_ORDER + 1)
        return [cls(j, float(n)) for j, far in travel.items() for n in orders if n * far > 3.0]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Fractional orders near by, as a gear ratio need not be whole, and with the overtone."""
        low, high = scope.span[f"q{self.joint}"]
        step = min(1.0 / (high - low), 0.5)
        near = [replace(self, order=self.order + k * step) for k in (-1.0, -0.5, 0.5, 1.0)]
        return near if self.doubled else [*near, replace(self, doubled=True)]

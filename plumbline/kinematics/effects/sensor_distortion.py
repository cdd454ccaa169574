r"""The device's error grows away from its axis, with distance or with depth.

.. math:: (x, y) \leftarrow (1 + k\,\rho^2)\,(x, y),\ \rho^2 = (x^2 + y^2)/z^2
          \text{ or } x^2 + y^2; \qquad
          y \leftarrow (1 + k\,(|y|^2 - f))\, y; \qquad y \leftarrow (1 + k\,(z - f))\, y

the first term of Brown's radial model along the device's z, the optical axis (Brown 1966,
Photogrammetric Engineering 32(3), eq. 7), by angle or by distance from that axis; its spherical
counterpart for a range finder; and a scale that changes with depth, as of a stereo pair. These two
are right where the device was calibrated, at f, somewhere within its field, or, of a pair whose
disparity is off by a constant, at the device itself. Where, is tried: a growth of nothing, together
with a level of its own, would be a scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.constants import FINER
from plumbline.kinematics.effects.effect import DEVICE_OBSERVATIONS, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter

NEAREST = 0.01  # depth [m] at which no camera sees; readings in a frame's own plane have less
KINDS = ("radial", "across", "range", "depth")
PLACES = 5  # within the field, evenly, where the device may be right to begin with


@dataclass(frozen=True)
class SensorDistortion(Effect):
    """A scale error that is not the same everywhere in the device's field."""

    kind: str = KINDS[0]
    right_at: float = 0.0  # square of the range [m^2], or depth [m], where there is no error

    name = "sensor_distortion"
    stage = Stage.SENSOR
    depends_on = "place"
    observations = DEVICE_OBSERVATIONS
    words = "the measuring device distorts: its error grows away from its axis or with depth"
    reference = "Brown (1966), Photogrammetric Engineering 32(3), eq. 7"
    source = "by hand: 0.2 % at a metre, what a lens is left with after its calibration"
    strength = Parameter("1", -1.0, 1.0, scale=2e-3, doc="growth (1/m by depth, 1/m^2 else)")

    @property
    def variant(self) -> str:
        """What the error grows with, and where there is none."""
        unit = {"range": "m^2 of squared range", "depth": "m of depth"}.get(self.kind, "")
        return f"kind {self.kind}" + (f", none at {self.right_at:.4g} {unit}" if unit else "")

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """All kinds; those by range or depth right at several places within the field."""
        placed = []
        for kind in KINDS[2:]:
            field = np.linspace(*scope.span.get(kind, (0.0, 0.0)), PLACES + 2)[1:-1]
            at_the_device = [0.0] * (kind == "depth" and bool(field.any()))
            placed += [cls(kind, float(f)) for f in np.unique([*at_the_device, *field])]
        return [*map(cls, KINDS[:2]), *placed]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Right elsewhere in the field, between those that are tried."""
        low, high = scope.span.get(self.kind, (0.0, 0.0))
        step = float(high - low) / (PLACES + 1)
        return [replace(self, right_at=self.right_at + k * step) for k in FINER if step]

    def apply(self, state: State, *values: cs.SX) -> State:
        y = state.reading
        if self.kind in KINDS[:2]:
            depth = cs.fmax(y[2] ** 2, NEAREST**2) if self.kind == "radial" else 1.0
            gain = values[0] * cs.sumsqr(y[:2]) / depth
            return replace(state, reading=y * (1 + cs.vertcat(gain, gain, 0)))
        field = cs.sumsqr(y) if self.kind == "range" else y[2]
        return replace(state, reading=y * (1 + values[0] * (field - self.right_at)))

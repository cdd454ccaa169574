r"""The device's error grows away from its axis, with distance or with depth.

.. math:: (x, y) \leftarrow (1 + k\,\rho^2)\,(x, y),\ \rho^2 = (x^2 + y^2)/z^2
          \text{ or } x^2 + y^2; \qquad
          y \leftarrow (1 + l + k\,|y|^2)\, y; \qquad y \leftarrow (1 + l + k\, z)\, y

the first term of Brown's radial model along the device's z, the optical axis (Brown 1966,
Photogrammetric Engineering 32(3), eq. 7), by angle or by distance from that axis; its spherical
counterpart for a range finder; and a scale that changes with depth, as a wrong base line of a
stereo pair gives. These two are right where the device was calibrated, somewhere in its field:
l says where.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.effects.effect import DEVICE_OBSERVATIONS, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter

NEAREST = 0.01  # depth [m] at which no camera sees; readings in a frame's own plane have less
KINDS = ("radial", "across", "range", "depth")


@dataclass(frozen=True)
class SensorDistortion(Effect):
    """A scale error that is not the same everywhere in the device's field."""

    kind: str = KINDS[0]

    name = "sensor_distortion"
    stage = Stage.SENSOR
    depends_on = "place"
    observations = DEVICE_OBSERVATIONS
    words = "the measuring device distorts: its error grows away from its axis or with depth"
    reference = "Brown (1966), Photogrammetric Engineering 32(3), eq. 7"
    source = "by hand: 0.2 % at a metre, what a lens is left with after its calibration"
    strength = Parameter("1", -1.0, 1.0, scale=2e-3, doc="growth (1/m by depth, 1/m^2 else)")
    level = Parameter("1", -0.1, 0.1, scale=2e-3, doc="scale where range or depth would be zero")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Off the axis nothing but the growth; by range or depth the level too."""
        return self.declared[: 1 if self.kind in KINDS[:2] else 2]

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """All kinds."""
        return [cls(kind) for kind in KINDS]

    def apply(self, state: State, *values: cs.SX) -> State:
        y = state.reading
        if self.kind in KINDS[:2]:
            depth = cs.fmax(y[2] ** 2, NEAREST**2) if self.kind == "radial" else 1.0
            gain = values[0] * cs.sumsqr(y[:2]) / depth
            return replace(state, reading=y * (1 + cs.vertcat(gain, gain, 0)))
        field = cs.sumsqr(y) if self.kind == "range" else y[2]
        return replace(state, reading=y * (1 + values[1] + values[0] * field))

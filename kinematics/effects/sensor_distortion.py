r"""The device's error grows with the distance from its axis, from its origin, or with depth.

.. math:: y \leftarrow (1 + k\, \rho^2)\, y, \qquad
          \rho^2 = y_x^2 + y_y^2, \quad |y|^2, \quad\text{or}\quad \rho^2 \to y_z

the first term of Brown's radial model (Brown 1966, Photogrammetric Engineering 32(3), eq. 7), its
spherical counterpart, and a scale that changes with depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs

from kinematics.effects.effect import DEVICE_OBSERVATIONS, Effect, Scope, Stage, State
from kinematics.parameters import Parameter

KINDS = ("axis", "origin", "depth")


@dataclass(frozen=True)
class SensorDistortion(Effect):
    """A scale error that is not the same everywhere in the device's field."""

    kind: str = KINDS[0]

    name = "sensor_distortion"
    stage = Stage.SENSOR
    observations = DEVICE_OBSERVATIONS
    words = "the measuring device distorts: its error grows away from its axis or with depth"
    reference = "Brown (1966), Photogrammetric Engineering 32(3), eq. 7"
    strength = Parameter("1/m^2", -1.0, 1.0, scale=1e-3, doc="growth (1/m where it is by depth)")

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """All three kinds."""
        return [cls(kind=kind) for kind in KINDS] if cls.fits(scope) else []

    def apply(self, state: State, *values: cs.SX) -> State:
        """Stretch the reading by its place in the field."""
        y = state.reading
        field = {"axis": cs.sumsqr(y[:2]), "origin": cs.sumsqr(y), "depth": y[2]}[self.kind]
        return replace(state, reading=y * (1 + values[0] * field))

r"""The base (or the device's stand) creeps while the recording lasts.

.. math:: T_{world,base} \leftarrow T_{world,base}\, \exp(s(t)\, \xi), \qquad
          s = \frac{1 - e^{-r (t - t_0)}}{1 - e^{-r (t_1 - t_0)}} \quad\text{or}\quad
          \frac{t - t_0}{t_1 - t_0} \text{ for } r = 0
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as cs
import numpy as np

from plumbline.kinematics.effects.effect import (
    FIDUCIALS,
    TIP_OBSERVATIONS,
    Effect,
    Scope,
    Stage,
    State,
)
from plumbline.kinematics.parameters import Parameter, between

# Time constants of what settles [length of the recording], a grid by hand: from a twentieth, where
# it is a step, to one and a half, where it is nearly steady, threefold apart.
SETTLING, APART = (0.05, 0.15, 0.5, 1.5), 3.0


@dataclass(frozen=True)
class BaseMotion(Effect):
    """Shared by drift and bump: a small twist of the base, translation first."""

    turning: bool = True

    stage = Stage.BASE
    observations = (*TIP_OBSERVATIONS, *FIDUCIALS)
    source = "by hand: frames and tripods settle by tenths of a millimetre; 20 mm is another set-up"
    x, y, z = Parameter("m", -0.02, 0.02, 3e-4, doc="shift along the base's {}").each(*"xyz")
    rx = Parameter("rad", -0.02, 0.02, scale=3e-4, doc="tilt about the base's x")
    ry = Parameter("rad", -0.02, 0.02, scale=3e-4, doc="tilt about the base's y")
    rz = Parameter("rad", -0.02, 0.02, scale=3e-4, doc="turn about the base's z")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The turn is left out of a motion that only shifts."""
        return self.declared if self.turning else self.declared[:3]

    @staticmethod
    def moved(state: State, share: cs.SX, values: tuple[cs.SX, ...]) -> State:
        """The state after a share of the twist."""
        twist = share * cs.vertcat(*values, *([cs.SX(0)] * (6 - len(values))))
        return state.move_base(twist[:3], twist[3:])


@dataclass(frozen=True)
class BaseDrift(BaseMotion):
    """Slow motion of the base; the parameters are what it adds up to by the end."""

    start: float = 0.0
    end: float = 1.0
    # reciprocal of the time constant with which it settles; none of what is steady
    rate: float = field(default=0.0, metadata={"unit": "1/s"})

    name = "base_drift"
    depends_on = "time"
    words = "the base or the measuring device drifted while the recording lasted"
    reference = "Mooring, Roth, Driels (1991), Fundamentals of Manipulator Calibration, ch. 6"
    needs = ("time",)

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Shift alone or with a turn; steady, or settling with some time constant."""
        start, end = scope.span["time"]
        rates = (0.0, *(1.0 / (share * (end - start)) for share in SETTLING))
        return [cls(turning, start, end, rate) for turning in (True, False) for rate in rates]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Time constants between those that are tried."""
        return between(self, "rate", APART) if self.rate else []

    def apply(self, state: State, *values: cs.SX) -> State:
        since, whole = state.row["time"] - self.start, self.end - self.start
        share = since / whole
        if self.rate:
            share = (1 - cs.exp(-self.rate * since)) / (1 - np.exp(-self.rate * whole))
        return self.moved(state, share, values)

r"""The base (or the device's stand) creeps while the recording lasts.

.. math:: T_{world,base} \leftarrow T_{world,base}\, \exp(s(t)\, \xi), \qquad
          s = (t - t_0)/(t_1 - t_0) \quad\text{or}\quad 1 - e^{-(t - t_0)/\tau}
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.effects.effect import (
    FIDUCIALS,
    TIP_OBSERVATIONS,
    Effect,
    Scope,
    Stage,
    State,
)
from plumbline.kinematics.parameters import Parameter


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
    settling: bool = False

    name = "base_drift"
    depends_on = "time"
    words = "the base or the measuring device drifted while the recording lasted"
    reference = "Mooring, Roth, Driels (1991), Fundamentals of Manipulator Calibration, ch. 6"
    needs = ("time",)

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Shift alone or with a turn; steady, or settling within a third of the recording."""
        start, end = scope.span["time"]
        kinds = ((turning, settling) for turning in (True, False) for settling in (False, True))
        return [cls(turning, start, end, settling) for turning, settling in kinds]

    def apply(self, state: State, *values: cs.SX) -> State:
        share = (state.row["time"] - self.start) / (self.end - self.start)
        if self.settling:
            share = 1 - cs.exp(-3 * share)
        return self.moved(state, share, values)

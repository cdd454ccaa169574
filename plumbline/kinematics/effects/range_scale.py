r"""The range finder's metre is not a metre: :math:`d \leftarrow (1 + k)\, d`."""

from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.effects.effect import RANGES, Effect, Stage, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class RangeScale(Effect):
    """A scale error of the range finder."""

    name = "range_scale"
    stage = Stage.SENSOR
    depends_on = "range"
    observations = RANGES
    words = "the range finder's scale is off"
    reference = "ISO 10360-8 (2013), sec. 6 (errors of optical distance sensors)"
    source = (
        "by hand: makers of range finders state a linearity of 0.03 to 0.2 % of the range; the "
        "bound is a wrong range setting"
    )
    scale = Parameter("1", -0.05, 0.05, scale=1e-3, doc="relative error of ranges")

    def apply(self, state: State, *values: cs.SX) -> State:
        return replace(state, reading=state.reading * (1 + values[0]))

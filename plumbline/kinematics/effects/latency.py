r"""The device's reading is of another instant: :math:`q \leftarrow q - \dot q\,\Delta t`."""

from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.effects.effect import ALL_OBSERVATIONS, Effect, Stage, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class Latency(Effect):
    """A delay between the joints' clock and the device's."""

    name = "latency"
    stage = Stage.SENSOR
    depends_on = "velocity"
    acts_at = Stage.JOINT
    observations = ALL_OBSERVATIONS
    needs = ("velocity",)
    words = "the device's reading is older or younger than the joints' reading"
    reference = "Furgale, Rehder, Siegwart (2013), IEEE/RSJ IROS, eq. 4 (first order)"
    source = "by hand: trackers answer within tens of milliseconds; a second is another recording"
    delay = Parameter("s", -1.0, 1.0, scale=5e-3, doc="age of the device's reading")

    def apply(self, state: State, *values: cs.SX) -> State:
        return replace(state, q=state.q - values[0] * state.row["velocity"])

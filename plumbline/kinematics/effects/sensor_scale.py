r"""The device's metre is not a metre: :math:`y \leftarrow (1 + k)\, y`, alike or axis by axis.

Where the tip rests in sockets, their stated distance is what measures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.effects.effect import TOOL_OBSERVATIONS, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter

MOST_STATED = 4.0  # of a maker's standard deviations; beyond, the statement is wrong


@dataclass(frozen=True)
class SensorScale(Effect):
    """A scale error of the measuring device."""

    alike: bool = True
    known_to: float = 0.0
    sockets: bool = False

    name = "sensor_scale"
    stage = Stage.SENSOR
    depends_on = "place"
    observations = TOOL_OBSERVATIONS
    words = "the measuring device's scale is off"
    reference = "ISO 10360-2 (2009), sec. 5"
    source = (
        "by hand: makers of trackers and measuring machines state 10 to 300 ppm; the bound is a "
        "wrong lens"
    )
    x, y, z = Parameter(
        "1", -0.05, 0.05, scale=3e-4, doc="relative error along the device's {}"
    ).each(*"xyz")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """One number where all axes are alike; within what the maker states, if that is known."""
        alike = replace(self.declared[0], doc="relative error, alike along all axes")
        found = (alike,) if self.alike else self.declared
        return tuple(map(self._stated, found)) if self.known_to else found

    @property
    def variant(self) -> str:
        """Whether its axes are alike, or what measures if that is no device."""
        if self.sockets:
            return "the stated distance of the sockets"
        return "" if self.alike else "not alike"

    def _stated(self, parameter: Parameter) -> Parameter:
        most = MOST_STATED * self.known_to
        said = f"the maker's statement, {self.known_to:.2g} (1 sigma)"
        return replace(parameter, lower=-most, upper=most, scale=self.known_to, source=said)

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Both kinds; of sockets, which have no axes, one."""
        if scope.observation == "fixed_point":
            return [] if cls.out_of_reach(scope) else [cls(sockets=True)]
        known_to = scope.span.get("scale_std", (0.0, 0.0))[0]
        return [cls(alike, known_to) for alike in (True, False)]

    @classmethod
    def out_of_reach(cls, scope: Scope) -> str:
        """Sockets without a stated distance have no scale."""
        stated = scope.observation != "fixed_point" or "distance" in scope.span
        return "" if stated else "no distance of sockets is stated"

    def apply(self, state: State, *values: cs.SX) -> State:
        gains = cs.vertcat(*(values if not self.alike else values * 3))
        return replace(state, reading=state.reading * (1 + gains))

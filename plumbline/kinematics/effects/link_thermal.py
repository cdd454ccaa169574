r"""All links grow with temperature, logged or guessed from the time since switch-on.

.. math:: t_{i,i+1} \leftarrow (1 + \epsilon\, w)\, t_{i,i+1}, \qquad
          w = T - T_{ref} \quad\text{or}\quad w = 1 - e^{-(t - t_0)/\tau}

or both, each with a growth of its own, where a thermometer beside the arm misses its warm-up. One
on the arm that lags by :math:`\tau` shows T where the links are at

.. math:: T + \tau\, \dot T

Nobody knows to a kelvin at what temperature the lengths of a model hold. How wide that makes a
growth that is always there follows from what :math:`\epsilon` was found to be.

First-order warm-up after Heisel, Richter, Wurst (1997), CIRP Annals 46(1).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import comb
from typing import ClassVar

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.constants import COLD
from plumbline.kinematics.effects.base_drift import APART, SETTLING
from plumbline.kinematics.effects.effect import UNSAID, Effect, Scope, Stage, State
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.frames import Transform
from plumbline.kinematics.parameters import Parameter, between
from plumbline.kinematics.weights import as_found

STANDARD_TEMPERATURE = 20.0
# [K], 1 sigma, of where a model's lengths hold: rooms in which arms are built and measured are kept
# to some kelvin; by hand (test_resembling.py fails at 0.3 and 30).
ROOM = 3.0
# Of the recording's length on either side, over which a slope of T is taken: of thermometers of 0.1
# and 0.01 K half and twice of it leave more of a warm-up untold.
SMOOTHED = 0.06
# Variance of times, in units of that, above which they tell a slope, and of their squares, less
# what a line has of them, above which they tell a bend: three times at even steps have 0.014, rows
# taken at once none.
APART_IN_TIME = 1e-3


class _Lengths(Effect):
    """Shared by both kinds: every length of the chain grows alike."""

    name = "link_thermal"
    stage = Stage.LINK
    depends_on = "temperature"
    words = "the links grow and shrink with temperature"
    reference = "Heisel, Richter, Wurst (1997), CIRP Annals 46(1), sec. 3"

    @staticmethod
    def _grow(state: State, by: cs.SX) -> State:
        grown = tuple(Transform(T.R, T.t * (1 + by)) for T in state.placements)
        return replace(state, placements=grown)


@dataclass(frozen=True)
class LinkThermal(_Lengths):
    """Growth with the logged temperature above a reference [degC]."""

    reference_temperature: float = field(default=STANDARD_TEMPERATURE, metadata={"unit": "degC"})
    found: tuple[float, ...] = field(default=(), metadata=UNSAID)

    needs: ClassVar[tuple[str, ...]] = ("temperature",)
    needs_one_of = ("temperature", "time")  # a warm-up over time will do, see candidates
    source = (
        "aluminium 23, steel 12 ppm/K (Heisel et al. 1997); the bound allows for a poor thermometer"
    )
    expansion = Parameter("1/K", -2e-3, 2e-3, scale=1.5e-5, doc="relative growth per kelvin")
    grown = Parameter(
        "1", -2e-2, 2e-2, scale=7.5e-5,
        doc="always there: by another reference, or as the device's scale",
    )  # fmt: skip

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """As declared; of another reference one more, as wide as :data:`ROOM` makes it."""
        own = self.declared[:-1]
        if not self.found:
            return own
        other = replace(self.grown, scale=ROOM * abs(self.found[0]))
        return (*as_found(own, self.found), other)

    @property
    def variant(self) -> str:
        """What it grows above."""
        return super().variant + ", or thereabouts" * bool(self.found)

    def deviations(self, scope: Scope, values: Sequence[float]) -> Sequence[Effect]:
        """The same above another temperature than the model was measured at."""
        return [replace(self, found=tuple(values))] if values[0] and not self.found else []

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """Warm-up over time, growth above 20 degC or above the coldest row, and both."""
        found: list[Effect] = []
        if cls.fits(scope):
            low, high = scope.span["temperature"]
            references = dict.fromkeys((STANDARD_TEMPERATURE, low)) if high - low > COLD else ()
            found += [cls(reference_temperature=reference) for reference in references]
            found += LinkAheadOfShown.candidates(scope) if found else []
            found += LinkWarmerThanShown.candidates(scope) if found else []
        return [*found, *LinkWarmUp.candidates(scope)]

    def apply(self, state: State, *values: cs.SX) -> State:
        above = state.row["temperature"] - self.reference_temperature
        return self._grow(state, values[0] * above + sum(values[1:]))


@dataclass(frozen=True)
class LinkAheadOfShown(LinkThermal):
    """Growth with a temperature that the thermometer shows late."""

    thermometer: str = "late"

    needs = ("time", "temperature")
    expansion = LinkThermal.expansion
    lag = Parameter("s/K", -2.0, 2.0, scale=1.5e-3, doc="relative growth per kelvin a second")
    grown = LinkThermal.grown

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """One form: by how much the thermometer lags is fitted."""
        return [cls()] if cls.fits(scope) else []

    def derive(self, rows: Mapping[str, Array]) -> Mapping[str, Array]:
        """How fast the thermometer rises [K/s]."""
        return {"warming": slope_of(np.ravel(rows["time"]), np.ravel(rows["temperature"]))}

    def apply(self, state: State, *values: cs.SX) -> State:
        above = state.row["temperature"] - self.reference_temperature
        late = values[1] * state.row["warming"]
        return self._grow(state, values[0] * above + late + sum(values[2:]))


def slope_of(time: Array, values: Array) -> Array:
    """Slopes (N,) of the parabolas through the readings (N,) about each time (N,), in any order.

    Between two readings alone it would be that of the thermometer's last digit, and of a line at
    either end the slope further in. About times at two places there is a line, at one none.
    """
    order = np.argsort(time, kind="stable")
    span = max(float(np.ptp(time)), np.finfo(float).tiny)
    t, v = ((time - time.mean()) / span)[order], (values - values.mean())[order]
    first = np.searchsorted(t, t - SMOOTHED)
    last = np.searchsorted(t, t + SMOOTHED, side="right")

    def about(power: int, x: Array | float = 1.0) -> Array:
        """Sums of x over the rows about each, by a power of their time from it."""
        found = np.zeros_like(t)
        for k in range(power + 1):
            total = np.append(0.0, np.cumsum(x * t**k))
            found += comb(power, k) * (-t) ** (power - k) * (total[last] - total[first])
        return found / SMOOTHED**power

    moments, against = [about(k) for k in range(5)], [about(k, v) for k in range(3)]
    bends = _bends(np.array(moments) / moments[0])
    slope = np.zeros_like(v)
    for degree in (1, 2):
        k, own = range(degree + 1), bends == degree
        A = np.array([[moments[i + j][own] for i in k] for j in k])
        b = np.array([against[j][own] for j in k])
        slope[order[own]] = np.linalg.solve(A.transpose(2, 0, 1), b.T[..., None])[:, 1, 0]
    return slope / (SMOOTHED * span)


def _bends(m: Array) -> NDArray[np.intp]:
    """Degrees (N,) of what times of these moments (5, N) tell: 0, 1 or 2."""
    spread = m[2] - m[1] ** 2
    skew = m[3] - m[1] * m[2]
    line = spread > APART_IN_TIME
    of_squares = m[4] - m[2] ** 2 - skew**2 / np.where(line, spread, 1.0)
    return line.astype(np.intp) + (line & (of_squares > APART_IN_TIME))


@dataclass(frozen=True)
class LinkWarmUp(_Lengths):
    """First-order growth over time, where no thermometer saw it."""

    time_constant: float = field(default=600.0, metadata={"unit": "s"})
    start: float = 0.0

    needs: ClassVar[tuple[str, ...]] = ("time",)
    source = (
        "aluminium 23, steel 12 ppm/K (Heisel et al. 1997); the bound allows for a poor thermometer"
    )
    growth = Parameter("1", -2e-2, 2e-2, scale=2e-4, doc="relative growth at the end of warm-up")

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """Time constants from a twentieth to twice the recording's length."""
        if not cls.fits(scope):
            return []
        start, end = scope.span["time"]
        return [cls(time_constant=share * (end - start), start=start) for share in SETTLING]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Time constants between those that are tried."""
        return between(self, "time_constant", APART)

    def apply(self, state: State, *values: cs.SX) -> State:
        since = state.row["time"] - self.start
        return self._grow(state, values[0] * (1 - cs.exp(-since / self.time_constant)))


@dataclass(frozen=True)
class LinkWarmerThanShown(LinkWarmUp):
    """Growth with the logged temperature, and with a warm-up that the thermometer does not show."""

    needs = ("time", "temperature")
    growth, expansion = LinkWarmUp.growth, LinkThermal.expansion

    def apply(self, state: State, *values: cs.SX) -> State:
        above = state.row["temperature"] - STANDARD_TEMPERATURE
        since = state.row["time"] - self.start
        warmed = 1 - cs.exp(-since / self.time_constant)
        return self._grow(state, values[0] * warmed + values[1] * above)

"""A parameter of an effect: its unit, its null value, and what is known of it before any data."""

from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.constants import FINER

Form = TypeVar("Form", bound=Any)


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter before a recording is looked at."""

    width: float  #: size to be expected on a real robot [unit]
    lower: float  #: least value that is physical [unit]
    upper: float  #: greatest value that is physical [unit]
    null: float = 0.0  #: the value at which the effect is absent [unit]
    source: str = ""  #: where width and range are from

    @property
    def sign(self) -> int:
        """1 or -1 where only values above or below the null are physical, else 0."""
        return int(self.null == self.lower) - int(self.null == self.upper)


@dataclass(frozen=True)
class Parameter:
    """One number of an effect, declared as a class attribute of it."""

    unit: str  #: SI unit, e.g. ``"rad"`` or ``"rad/(N m)"``
    lower: float  #: lower bound [unit]
    upper: float  #: upper bound [unit]
    scale: float  #: size to be expected on a real robot [unit]; the prior's width
    null: float = 0.0  #: the value at which the effect is absent [unit]
    doc: str = ""  #: what it is, in a few words
    name: str = ""  #: filled in by the effect that declares it
    #: where scale and bounds are from: a maker, a paper, an experiment, or by hand
    source: str = ""

    @property
    def prior(self) -> Prior:
        """Width, range and sign, with their source."""
        return Prior(self.scale, self.lower, self.upper, self.null, self.source)

    def of_width(self, factor: float) -> Self:
        """The same parameter of a robot on which it and its bounds are so many times as large."""
        lower, upper = self.null + factor * (np.array([self.lower, self.upper]) - self.null)
        return replace(self, lower=float(lower), upper=float(upper), scale=self.scale * factor)

    def each(self, *words: str) -> tuple[Self, ...]:
        """One like it for each of these words, which take the place of ``{}`` in ``doc``."""
        return tuple(replace(self, doc=self.doc.format(word)) for word in words)

    def __post_init__(self) -> None:
        """Refuse a declaration that contradicts itself."""
        if not self.lower <= self.null <= self.upper:
            raise PlumblineError(
                f"Parameter {self.name or self.doc!r}: null {self.null} is outside of its bounds "
                f"{self.lower} <= x <= {self.upper}; widen the bounds"
            )
        if self.scale <= 0.0:
            raise PlumblineError(
                f"Parameter {self.name or self.doc!r}: scale {self.scale} must be > 0"
            )


def between(form: Form, name: str, ratio: float) -> list[Form]:
    """Forms between those that are tried of a field, each so many times the one before.

    However far a gap stands out of the noise, a width that is tried no finer leaves some of it.
    """
    value = getattr(form, name)
    return [replace(form, **{name: value * ratio**share}) for share in FINER]

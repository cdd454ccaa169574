"""What a fit reports: misfits in four numbers, and every parameter with what is known of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class Misfit:
    """Lengths of misfits [m]."""

    mean: float  # their mean
    max: float  # the largest
    std: float  # their standard deviation
    rms: float  # root of their mean square
    count: int  # how many

    @classmethod
    def of(cls, misfits: Array) -> Misfit:
        """Of misfits (N, 3) [m]."""
        sizes = np.linalg.norm(misfits, axis=1)
        rms = float(np.sqrt(np.mean(sizes**2)))
        return cls(float(sizes.mean()), float(sizes.max()), float(sizes.std()), rms, len(sizes))

    @property
    def numbers(self) -> dict[str, float]:
        """Mean, largest, standard deviation and RMS by their names [m]."""
        return {key: getattr(self, key) for key in ("mean", "max", "std", "rms")}


class Status(StrEnum):
    """What is known of a parameter."""

    IDENTIFIED = "identified"
    IN_A_SUM = "known in a sum"
    AT_BOUND = "at bound"
    NOT_IDENTIFIABLE = "not identifiable"


@dataclass(frozen=True)
class DHParameter:
    """One parameter of the links, or one coordinate of the tool."""

    name: str  # ``joint 2 a``, ``tip d``, ``tool z``
    unit: str  # ``m`` or ``rad``
    nominal: float  # what the drawing says
    value: float | None  # the estimate; None if it cannot be identified by itself
    std: float | None  # its standard error; None if there is none
    status: Status  # what is known of it
    words: str  # why there is no estimate, or no standard error

    def to_dict(self) -> dict[str, Any]:
        """Its fields, the words by the name of "why"."""
        found = asdict(self)
        return found | {"status": self.status.value, "why": found.pop("words")}

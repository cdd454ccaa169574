"""What a verdict on several recordings says of each of them, and of what carries over."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum


class Carries(StrEnum):
    """What one recording says of a cause that the others show."""

    YES = "transfers"
    NO = "differs"
    UNTOLD = "cannot tell"
    ONLY = "here only"


@dataclass(frozen=True)
class OfRecording:
    """Figures of one recording under the joint fit, on rows that were left out of it.

    Attributes:
        name: What it is called.
        observation: What a row measured.
        rows: Number of its rows.
        unit: Of its gap and noise, ``"m"`` or ``"rad"``.
        before: RMS with its nuisances alone [unit].
        after: RMS with the causes [unit].
        without_it: RMS with causes that were fitted to the other recordings alone, its own
            nuisances fitted to it [unit].
        noise: One standard deviation of one axis [unit].
        noise_source: ``"given"``, or ``"repeats"`` or ``"fit"`` where its own rows have told it.
        gross: Its rows (from 1) that were taken for gross errors.
    """

    name: str
    observation: str
    rows: int
    unit: str
    before: float
    after: float
    without_it: float
    noise: float
    noise_source: str
    gross: tuple[int, ...] = ()


@dataclass(frozen=True)
class Compared:
    """One parameter, fitted to one recording alone and to all others together.

    Attributes:
        value: What the recording alone says [unit].
        std: Its standard error, infinite where it says nothing [unit].
        others: What the others say [unit].
        others_std: Its standard error [unit].
        unit: The parameter's unit.
    """

    value: float
    std: float
    others: float
    others_std: float
    unit: str


@dataclass(frozen=True)
class Transfer:
    """Whether a cause is in one recording what it is in all others.

    Attributes:
        effect: Name of the effect.
        element: Joint, link or marker, from 1, or None.
        recording: The recording that is held against the others.
        carries: Whether it is the same there.
        z: How many standard errors it is off, those of both; NaN where that cannot be told.
        parameters: Its parameters by name.
    """

    effect: str
    element: int | None
    recording: str
    carries: Carries
    z: float = math.nan
    parameters: dict[str, Compared] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The effect with its element."""
        return self.effect if self.element is None else f"{self.effect} {self.element}"

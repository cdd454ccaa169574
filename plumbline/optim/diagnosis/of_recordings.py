"""What a verdict says of each recording, of each joint, and of what carries over."""

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
    """Figures of one recording under the joint fit, on rows that were left out of it."""

    name: str  # what it is called
    observation: str  # what a row measured
    rows: int  # number of its rows
    unit: str  # of its gap and noise, ``"m"`` or ``"rad"``
    before: float  # RMS with its nuisances alone [unit]
    after: float  # RMS with the causes [unit]
    # RMS with causes that were fitted to the other recordings alone, its own nuisances fitted to it
    # [unit]
    without_it: float
    noise: float  # one standard deviation of one axis [unit]
    noise_source: str  # ``"given"``, or ``"repeats"`` or ``"fit"`` where its own rows have told it
    gross: tuple[int, ...] = ()  # its rows taken for gross errors, the header being row 1


@dataclass(frozen=True)
class JointGap:
    """What one joint is missed by, on rows that were left out: RMS before and after [unit]."""

    element: int  # the joint, or the tip's axis, from 1
    label: str  # as in ``"joint 3"``
    before: float  # of the nominal robot
    after: float  # with the causes
    unit: str  # what was measured of this joint, ``"rad"``, ``"m"``, ``"N m"`` or ``"N"``


@dataclass(frozen=True)
class TurnGap:
    """How far poses are turned, on rows that the fit has not seen, which their places do not show.

    Attributes:
        before: RMS of the turns with nuisances alone [rad].
        after: RMS with the causes [rad].
        noise_floor: RMS that noise alone would give [rad]; None where only the fit tells the noise.
    """

    before: float
    after: float
    noise_floor: float | None = None


@dataclass(frozen=True)
class AgainstOthers:
    """One parameter, fitted to one recording alone and to all others together."""

    value: float  # what the recording alone says [unit]
    std: float  # its standard error, infinite where it says nothing [unit]
    others: float  # what the others say [unit]
    others_std: float  # its standard error [unit]
    unit: str  # the parameter's unit


@dataclass(frozen=True)
class Transfer:
    """Whether a cause is in one recording what it is in all others."""

    effect: str  # name of the effect
    element: int | None  # joint, link or marker, from 1, or None
    recording: str  # the recording that is held against the others
    carries: Carries  # whether it is the same there
    # how many standard errors it is off, those of both; NaN where that cannot be told
    z: float = math.nan
    parameters: dict[str, AgainstOthers] = field(default_factory=dict)  # its parameters by name

    @property
    def label(self) -> str:
        """The effect with its element."""
        return self.effect if self.element is None else f"{self.effect} {self.element}"

"""The verdict: what a diagnosis says, as an object, as JSON and in words.

It says what it does not know: probabilities, intervals, what cannot be told apart or not seen.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import Judgement
from plumbline.optim.core.quantities import chance, quantity
from plumbline.optim.diagnosis.constants import LISTED
from plumbline.optim.diagnosis.meaning import (
    MEANING,
    MEANING_BY_FORM,
    NOISIER,
    NOT_FORETOLD,
    NOT_SHOWN,
    NOTHING_FURTHER,
    ON_A_BOUND,
    ONLY_CONFOUNDED,
    TOO_FEW,
)
from plumbline.optim.diagnosis.of_recordings import JointGap, OfRecording, Transfer, TurnGap
from plumbline.optim.diagnosis.prior import EARNED, FAR, UNLISTED

Key = tuple[str, int | None]  # an effect's name and the element that it is blamed on


class Outcome(StrEnum):
    """What a verdict comes to."""

    NO_GAP = "no-gap"
    EXPLAINED = "explained"
    PARTLY = "partly-explained"
    OUTSIDE = "outside-library"

    @classmethod
    def of(cls, causes: bool, *, beyond: bool, earned: bool) -> "Outcome":
        """By whether causes are named, anything else is at work, and the gap may be explained."""
        if causes:
            return cls.EXPLAINED if earned else cls.PARTLY
        return cls.OUTSIDE if beyond else cls.NO_GAP


# What an element of a stage is: planes are read by a sensor, markers registered.
NOUNS = {
    "joint": "joint", "link": "link", "actuation": "drive", "registration": "marker",
    "sensor": "plane",
}  # fmt: skip


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter.

    Attributes:
        value: Its value [unit].
        std: Its standard error [unit].
        unit: Its unit.
        at_bound: Whether it rests on a bound, so that value and std mean little.
        doc: What it is, in a few words.
        determined: Whether the rows say more of it than was known before them.
    """

    value: float
    std: float
    unit: str
    at_bound: bool = False
    doc: str = ""
    determined: bool = True


@dataclass(frozen=True)
class Blame:
    """An effect on an element, by its name in the library.

    Attributes:
        effect: Name of the effect.
        stage: Stage of the chain.
        element: Joint or link, from 1; None if the effect has none.
        why: Why it is listed here, in words.
    """

    effect: str
    stage: str
    element: int | None
    why: str = ""

    @property
    def label(self) -> str:
        """For example ``joint_offset of joint 3``."""
        place = NOUNS.get(self.stage, "element")
        return self.effect if self.element is None else f"{self.effect} of {place} {self.element}"


@dataclass(frozen=True)
class Curve:
    """A joint's error over its angle, with the band of one standard error.

    Attributes:
        angle: Readings of the joint (K,) [rad].
        value: Its error there (K,) [rad].
        std: Standard error of that (K,) [rad].
    """

    angle: tuple[float, ...]
    value: tuple[float, ...]
    std: tuple[float, ...]


@dataclass(frozen=True)
class FrictionCurve:
    """What a drive's friction takes over its speed, with the band of one standard error.

    Attributes:
        joint: The joint, from 1.
        velocity: Its velocity (K,) [rad/s or m/s], none of them zero.
        torque: Friction there (K,) [N m or N], positive against a positive velocity.
        std: Standard error of that (K,) [N m or N].
    """

    joint: int
    velocity: tuple[float, ...]
    torque: tuple[float, ...]
    std: tuple[float, ...]


@dataclass(frozen=True)
class Cause(Blame):
    """A cause, or a candidate for one.

    Attributes:
        probability: Probability that it is at work, given all else in the verdict.
        parameters: Its estimates by name.
        before: Held-out RMS without it, all else kept [gap's unit].
        after: Held-out RMS with it [gap's unit].
        confounded_with: What this recording cannot tell from it.
        words: What it means, in one sentence.
        variant: Which of its forms it is: the other joint, the moment, the width, the order.
        curve: Of a ripple, all its orders together.
        sensitivity: Its probability with prior odds of every cause a third, and three times as
            high; none where it was not worked out.
    """

    probability: float = 0.0
    parameters: dict[str, Estimate] = field(default_factory=dict)
    before: float = math.nan
    after: float = math.nan
    confounded_with: tuple[Blame, ...] = ()
    words: str = ""
    variant: str = ""
    curve: Curve | None = None
    sensitivity: tuple[float, float] | None = None

    def __repr__(self) -> str:
        return f"<Cause: {self.label}, {chance(self.probability)}>"


@dataclass(frozen=True)
class Gap:
    """How large the gap is and how far it shrinks, on rows that the fit has not seen.

    Position gaps are root mean squares of the distance in space; gaps of joint encoders are root
    mean squares of one reading.

    Attributes:
        unit: ``"m"`` or ``"rad"``.
        before: RMS with nuisances alone.
        after: RMS with the causes.
        noise_floor: RMS that noise alone would give; of noise that only the fit tells, what the
            fit itself leaves, which JSON has as null.
        shrink: 1 - after / before.
        shrink_ci95: Its 95 % interval, by a paired bootstrap over blocks.
        held_out: Always true: figures are of rows that were left out.
        held_out_by: What was left out together.
        removable: Share of what can be removed, (before - after) / (before - noise_floor), by
            chance more than one; NaN where the noise is known from the fit alone.
        rotation: The same of the turns of poses; None of other readings.
    """

    unit: str
    before: float
    after: float
    noise_floor: float
    shrink: float
    shrink_ci95: tuple[float, float]
    held_out: bool = True
    held_out_by: str = "rows"
    removable: float = math.nan
    rotation: TurnGap | None = None

    @property
    def is_far(self) -> bool:
        """Whether rows left out are missed by far more than the noise."""
        return self.after > FAR * self.noise_floor


@dataclass(frozen=True)
class Place:
    """Share of the explained gap that sits at one stage and element."""

    stage: str
    element: int | None
    share: float


@dataclass(frozen=True)
class Step:
    """One step of the staircase: the held-out gap once this cause is in, with all before it."""

    label: str
    gap: float


@dataclass(frozen=True)
class NoiseLevel:
    """One standard deviation of one measured axis, and where it is known from.

    Attributes:
        sigma: The noise [m] or [rad].
        source: ``"given"``, ``"repeats"`` or ``"fit"``.
        ratio: Residual after the verdict over the noise; 1 if all is explained.
        repeats: Readings that repeat another one, where the noise is estimated from those.
    """

    sigma: float
    source: str
    ratio: float
    repeats: int = 0


@dataclass(frozen=True)
class Verdict(Answer):
    """What the diagnosis says; see the attributes' own classes for units.

    Attributes:
        verdict: One of :class:`Outcome`.
        gap: How large, how far it shrinks.
        where: Shares by stage and element, which sum to one.
        causes: The causes, most important first.
        candidates: Everything considered, most probable first.
        outside_probability: Probability that something outside the library is at work.
        outside_depends_on: What that unknown depends on, in words, if anything is seen.
        tree: Place, dependence, mechanism, with probabilities that add up from each to the one
            above; ``effect`` is None for a mechanism that the library lacks.
        unlisted_prior: Prior probability that a gap comes of what the library lacks.
        unobservable: Effects that this recording cannot see, and why.
        next: What to record next.
        staircase: The gap after each cause.
        noise: The noise and where it is known from.
        distrusted_rows: Rows taken for gross errors and left out, the header of a file being row 1.
        notes: What else the reader should know.
        judged: Whether every fit behind the verdict converged, with the figures.
        recording: Name of the recording.
        rows: Number of its rows.
        sha256: Hash of its files.
        nuisances: Frame, tool, sockets and what else was always fitted, by name.
        recordings: Figures of each recording, where the verdict is on several.
        transfer: Which causes are in each of them what they are in the others.
        unmet: By how much rows miss the model, where they may not be of that robot at all.
        unjudged: What the recording holds that takes no part, such as ``"3 targets"``.
        friction: Friction of drives over their speed, where efforts were measured.
        joints: The gap joint by joint, where each joint is measured by itself.
    """

    verdict: Outcome
    gap: Gap
    where: tuple[Place, ...] = ()
    causes: tuple[Cause, ...] = ()
    candidates: tuple[Cause, ...] = ()
    outside_probability: float = 0.0
    outside_depends_on: str = ""
    tree: tuple[dict[str, Any], ...] = ()
    unlisted_prior: float = UNLISTED
    unobservable: tuple[Blame, ...] = ()
    next: tuple[dict[str, Any], ...] = ()
    staircase: tuple[Step, ...] = ()
    noise: NoiseLevel = NoiseLevel(math.nan, "fit", math.nan)
    distrusted_rows: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    judged: Judgement = field(default_factory=Judgement)
    recording: str = ""
    rows: int = 0
    sha256: str = ""
    nuisances: dict[str, Estimate] = field(default_factory=dict)
    recordings: tuple[OfRecording, ...] = ()
    transfer: tuple[Transfer, ...] = ()
    unmet: str = ""
    unjudged: str = ""
    friction: tuple[FrictionCurve, ...] = ()
    joints: tuple[JointGap, ...] = ()

    @property
    def frame(self) -> dict[str, Estimate]:
        """The robot's base in the device's frame: its origin [m] and a rotation vector [rad]."""
        return self._nuisances("frame ")

    @property
    def tool(self) -> dict[str, Estimate]:
        """The tool's tip in the tip frame [m]; of poses its rotation vector too [rad]."""
        return self._nuisances("tool ")

    @property
    def sockets(self) -> dict[str, Estimate]:
        """Places of the sockets in the robot's base frame [m]."""
        return self._nuisances("socket ")

    @property
    def zeros(self) -> dict[str, Estimate]:
        """Zeros of encoders, where they are always fitted [rad or m]."""
        return self._nuisances("joint_offset ")

    def _nuisances(self, begin: str) -> dict[str, Estimate]:
        return {name: e for name, e in self.nuisances.items() if name.startswith(begin)}

    @property
    def knows_noise(self) -> bool:
        """Whether the noise is known apart from the fit, as stated or from repeats."""
        return self.noise.source != "fit"

    @property
    def is_missed(self) -> bool:
        """Whether rows left out are missed by far more than their noise, if that is known."""
        return self.knows_noise and self.gap.is_far

    @property
    def is_noisier(self) -> bool:
        """Whether what is left exceeds a stated noise, and is noise."""
        given = self.noise.source == "given" and self.outside_probability < UNLISTED
        return given and self.noise.ratio > EARNED

    @property
    def warnings(self) -> tuple[str, ...]:
        """What takes from the weight of every figure: another robot, fits that have not ended."""
        doubts = (*filter(None, [self.unmet]), *self.judged.failures)
        return tuple(f"not to be relied on: {line}" for line in doubts)

    @property
    def meaning(self) -> str:
        """What kind of verdict it is, in one sentence, and what was not judged in another."""
        return self._meaning + (f" Not judged: {self.unjudged}." if self.unjudged else "")

    @property
    def _meaning(self) -> str:
        if self.verdict == Outcome.PARTLY and self.gap.shrink_ci95[0] <= 0.0:
            return NOT_SHOWN
        if self.verdict in (Outcome.PARTLY, Outcome.NO_GAP) and self.is_noisier:
            return NOISIER
        if self.verdict == Outcome.PARTLY and self.outside_probability < UNLISTED:
            if self.is_missed:
                return NOT_FORETOLD
            if not self.knows_noise:
                return NOTHING_FURTHER
            if any(e.at_bound for cause in self.causes for e in cause.parameters.values()):
                return ON_A_BOUND
        if self.verdict == Outcome.NO_GAP and self.is_missed:
            return TOO_FEW
        if self.verdict == Outcome.OUTSIDE and self.gap.shrink_ci95[0] > 0.0:
            return ONLY_CONFOUNDED
        return (MEANING if self.knows_noise else MEANING_BY_FORM)[self.verdict]

    @property
    def headline(self) -> str:
        """``bench-ur5: explained; backlash of joint 2 (98 %); 0.451 mm -> 0.131 mm``."""
        named = [f"{c.label} ({chance(c.probability)})" for c in self.causes[:LISTED]]
        more = len(self.causes) - LISTED
        listed = ", ".join(named) + f" and {more} more" * (more > 0)
        sizes = " -> ".join(quantity(v, self.gap.unit) for v in (self.gap.before, self.gap.after))
        left = f"not judged: {self.unjudged}" * bool(self.unjudged)
        parts = filter(None, (self.verdict.value, listed, sizes, left))
        return f"{self.recording[:40]}: {'; '.join(parts)}"

    def to_dict(self) -> dict[str, Any]:
        """Its figures as plain data; a floor that nobody knows is none."""
        held = vars(self) | {"transfer": self.recordings}
        optional = ("recordings", "transfer", "unmet", "unjudged", "friction", "joints")
        found = {k: v for k, v in super().to_dict().items() if k not in optional or held[k]}
        if not self.knows_noise:
            found["gap"]["noise_floor"] = None
        return found

    def __repr__(self) -> str:
        return f"<Verdict on {self.headline}>"

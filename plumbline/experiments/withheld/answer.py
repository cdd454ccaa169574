r"""What a diagnosis answered, as its verdict file says, and which true cause each answer names.

Strictly, a cause is right if effect and element are those of a true cause. Of confounded ones, what
the truth file lists is right as well: another effect or element that this recording cannot tell
from the true cause. Each true cause can be answered once, and the answers are matched so that as
many as possible are right,

.. math:: \text{found} = \max_{\text{matching } M} |M|, \qquad
          \text{added} = |\text{named}| - \text{found}.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from plumbline.errors import PlumblineError
from plumbline.experiments.withheld.truth import Truth, key_of, number_of
from plumbline.kinematics.files import read_file, reason
from plumbline.optim.diagnosis.findings import Key

FLAGGED = ("outside-library", "partly-explained")
ROUNDING = 1e-9  # by which a sum of probabilities may exceed one
LIKELY = 0.5  # probability above which an unlisted mechanism is thought to be there
Place = tuple[str, int | None]  # stage and element


@dataclass(frozen=True)
class StatedCause:
    """That an effect is at work, with its probability, and what may be at work instead."""

    key: Key
    probability: float
    rivals: tuple[Key, ...] = ()


@dataclass(frozen=True)
class StatedVerdict:
    """A verdict, as far as it is scored."""

    case: str  # name of the case
    verdict: str  # the verdict's word
    causes: tuple[StatedCause, ...]  # what it names, most important first
    candidates: tuple[StatedCause, ...] = ()  # all that it ranks, the causes among them
    outside: float = 0.0  # probability that something unknown is at work
    outside_words: str = ""  # on what that depends
    before: float | None = None  # held-out RMS without the causes [unit]; None if not given
    after: float | None = None  # held-out RMS with them [unit]
    unit: str = "m"  # ``m`` or ``rad``
    recording: str = ""  # SHA-256 of the recording that was diagnosed; empty if not stated
    without: tuple[str, ...] = ()  # effects that the library did without
    places: tuple[Place, ...] = ()  # where it says that the gap is, most probable first
    unlisted: float = 0.0  # probability of the likeliest mechanism that it has no name for

    @property
    def flags_outside(self) -> bool:
        """Whether it says that something beyond its causes is at work."""
        return self.verdict in FLAGGED or max(self.outside, self.unlisted) > LIKELY

    @property
    def first(self) -> Key | None:
        """The first cause, if any."""
        return self.causes[0].key if self.causes else None

    @property
    def ranked_first(self) -> Key | None:
        """The most probable single answer, whether or not it was thought enough to be named."""
        listed = self.causes[:1] or sorted(self.candidates, key=lambda s: -s.probability)[:1]
        return listed[0].key if listed else None


def read_answer(path: Path) -> StatedVerdict:
    """Read a verdict file (PlumblineError: it is no verdict)."""
    try:
        return _answer(path.stem, json.loads(read_file(path)))
    except OSError as error:
        raise PlumblineError(f"{path}: the verdict cannot be read ({reason(error)})") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise PlumblineError(f"{path}: no verdict; expected keys verdict, causes, gap") from None


def _answer(case: str, content: dict[str, Any]) -> StatedVerdict:
    gap, stamp = content.get("gap") or {}, content.get("withheld") or {}
    return StatedVerdict(
        case=case,
        verdict=str(content["verdict"]),
        causes=tuple(_statement(c) for c in content["causes"]),
        candidates=tuple(_statement(c) for c in content.get("candidates", ())),
        outside=float(content.get("outside_probability") or 0.0),
        outside_words=str(content.get("outside_depends_on") or ""),
        before=number_of(gap, "before"),
        after=number_of(gap, "after"),
        unit=str(gap.get("unit", "m")),
        recording=str(stamp.get("recording", "")),
        without=tuple(stamp.get("without", ())),
        places=_places(content),
        unlisted=max(_nameless(content), default=0.0),
    )


def _places(content: dict[str, Any]) -> tuple[Place, ...]:
    """Places by probability, or by share where there is no tree."""
    key, listed = "probability", content.get("tree") or ()
    if not listed:
        key, listed = "share", content.get("where") or ()
    ranked = sorted(listed, key=lambda place: -float(place[key]))
    return tuple((str(place["stage"]), key_of({"effect": "", **place})[1]) for place in ranked)


def _nameless(content: dict[str, Any]) -> Iterator[float]:
    """Probabilities of the tree's mechanisms that have no name."""
    for place in content.get("tree") or ():
        for dependence in place["dependences"]:
            for mechanism in dependence["mechanisms"]:
                if mechanism["effect"] is None:
                    yield float(mechanism["probability"])


def _statement(entry: dict[str, Any]) -> StatedCause:
    probability = float(entry["probability"])
    if not 0.0 <= probability <= 1.0 + ROUNDING:
        raise PlumblineError(f"probability: found {probability}, expected 0 to 1; mend it")
    rivals = tuple(key_of(rival) for rival in entry.get("confounded_with") or ())
    return StatedCause(key_of(entry), min(probability, 1.0), rivals)


@dataclass(frozen=True)
class ScoredCase:
    """A case's truth and the answer to it."""

    truth: Truth
    answer: StatedVerdict

    def fits(self, named: Key, *, confounded: bool) -> bool:
        """Whether a cause that was named is a true one or, if that counts, confounded with one."""
        return any(self._same(named, true, confounded) for true in self.truth.causes)

    def effect_fits(self, named: Key, *, confounded: bool) -> bool:
        """Whether the effect is right, whatever its element."""
        rivals = {rival[0] for _, rival in self.truth.confounded} if confounded else set()
        return named[0] in {true[0] for true in self.truth.causes} | rivals

    @cached_property
    def found(self) -> int:
        """True causes that were named."""
        return self._found(confounded=False)

    @cached_property
    def found_or_confounded(self) -> int:
        """True causes that were named, or what they are confounded with."""
        return self._found(confounded=True)

    def _same(self, named: Key, true: Key, confounded: bool) -> bool:
        return named == true or (confounded and (true, named) in self.truth.confounded)

    def _found(self, *, confounded: bool) -> int:
        named = [statement.key for statement in self.answer.causes]
        if not named or not self.truth.causes:
            return 0
        right = [[self._same(n, t, confounded) for t in self.truth.causes] for n in named]
        table = np.array(right, dtype=float)
        return int(table[linear_sum_assignment(table, maximize=True)].sum())

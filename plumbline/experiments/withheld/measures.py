"""What is counted: one line a figure, each a share of statements or cases.

A measure says for one case how many of how many it adds; the shares of a group are the sums. Where
a figure ends in ``_or_twin``, an effect that the recording cannot tell from the true one counts as
right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from plumbline.experiments.withheld.answer import Answer
from plumbline.experiments.withheld.matching import Judged
from plumbline.experiments.withheld.truth import Sort
from plumbline.kinematics.effects import REGISTRY

Counted = tuple[int, int]
SURE = 0.95
NEAR_FLOOR = 1.1
PLACES = {"position": ("place of the tip",), "posture": ("posture",), "rows": ("rows ",)}


@dataclass(frozen=True)
class Measure:
    """One figure."""

    key: str  # its name in JSON
    words: str  # its name for people
    count: Callable[[Judged], Counted]  # how many of how many a case adds
    better: int = 1  # whether more is better, less is, or neither: 1, -1, 0


def in_library(case: Judged) -> bool:
    """Whether something is wrong and the library has all of it."""
    return case.truth.sort in {Sort.SINGLE, Sort.SEVERAL}


def outside(case: Judged) -> bool:
    """Whether the library lacks all that is wrong, and has nothing that looks the same."""
    known = {true for true, _ in case.truth.twins}
    return case.truth.sort is Sort.OUTSIDE and not known & set(case.truth.causes)


def _cases(over: Callable[[Judged], bool], hit: Callable[[Judged], bool]) -> Callable[..., Counted]:
    """Count cases: those of a kind, and those among them that are hit."""
    return lambda case: (int(hit(case)), 1) if over(case) else (0, 0)


def _first(twins: bool, ranked: bool, element: bool) -> Callable[[Judged], bool]:
    def hit(case: Judged) -> bool:
        answer = case.answer.ranked_first if ranked else case.answer.first
        if not element:
            return case.effect_fits(answer, twins=twins)
        return answer is not None and case.fits(answer, twins=twins)

    return hit


def _listed(case: Judged) -> bool:
    """Whether a true cause is the first answer or among what the verdict says it may be instead."""
    if not case.answer.causes:
        return False
    first = case.answer.causes[0]
    return any(case.fits(key, twins=False) for key in (first.key, *first.rivals))


def _all_found(case: Judged) -> bool:
    return case.found == len(case.truth.causes)


def _all_found_or_twin(case: Judged) -> bool:
    return case.found_or_twin == len(case.truth.causes)


def _several(case: Judged) -> bool:
    return case.truth.sort is Sort.SEVERAL


def _statements(case: Judged, added: int) -> Counted:
    """Causes added among causes named, where something known or nothing is wrong."""
    known = case.truth.sort is not Sort.OUTSIDE
    return (added, len(case.answer.causes)) if known else (0, 0)


def _sure(case: Judged, *, twins: bool) -> Counted:
    sure = [s.key for s in case.answer.causes if s.probability > SURE]
    return sum(case.fits(key, twins=twins) for key in sure), len(sure)


def _wrong_and_sure(case: Judged) -> bool:
    sure = [s.key for s in case.answer.causes if s.probability > SURE]
    return any(not case.fits(key, twins=True) for key in sure)


def names_dependence(depends_on: tuple[str, ...], answer: Answer) -> bool:
    """Whether the answer names a thing that the unknown effect truly depends on.

    ``q3``, alone or within a phrase, asks for joint 3; other words for themselves or what
    :data:`PLACES` lists.
    """
    said = answer.outside_words
    for token in depends_on:
        joint = token.split()[-1].removeprefix("q")
        if joint.isdigit():
            if f"joint {joint}'s" in said:
                return True
        elif any(word in said for word in PLACES.get(token, (token,))):
            return True
    return False


def floor_of(case: Judged) -> float | None:
    """What noise alone would leave: sigma per reading, root 3 sigma for a distance in space."""
    return _per_point(case, case.truth.noise_std)


def _per_point(case: Judged, sigma: float | None) -> float | None:
    return None if sigma is None else sigma * (3.0**0.5 if case.answer.unit == "m" else 1.0)


def _reaches(floor_of: Callable[[Judged], float | None]) -> Callable[[Judged], Counted]:
    """Whether what is left on rows kept back comes near a floor."""

    def count(case: Judged) -> Counted:
        floor, after = floor_of(case), case.answer.after
        if not in_library(case) or floor is None or after is None:
            return 0, 0
        return int(after <= NEAR_FLOOR * floor), 1

    return count


_at_own_noise = _reaches(lambda case: _per_point(case, case.truth.noise_rms))


def _untimed(case: Judged) -> Counted:
    """The same of causes that time does not drive.

    A bump within a stretch that is left out cannot be told from the rows around it.
    """
    effects = [REGISTRY[name] for name, _ in case.truth.causes if name in REGISTRY]
    if any(effect.runs_with_time() for effect in effects):
        return 0, 0
    return _at_own_noise(case)


def _beside(case: Judged) -> bool:
    return case.truth.sort is Sort.PARTLY


def _known_found(case: Judged) -> bool:
    named = {statement.key for statement in case.answer.causes}
    return any(
        named & {cause, *(rival for true, rival in case.truth.twins if true == cause)}
        for cause in case.truth.known
    )


def _flagged(case: Judged) -> bool:
    return case.answer.flags_outside


def _known_or_nothing(case: Judged) -> bool:
    return in_library(case) or case.truth.sort is Sort.NONE


def _top(words: str, key: str, *, ranked: bool = False) -> list[Measure]:
    """Four measures of the first answer: effect or element, strictly or twin-aware."""
    found = []
    for element, what in ((False, "effect"), (True, "element")):
        for twins, suffix in ((False, ""), (True, "_or_twin")):
            name = f"{words} effect" + (" + element" if element else "")
            name += ", or twin" if twins else ""
            count = _cases(in_library, _first(twins, ranked, element))
            found.append(Measure(f"{key}_{what}{suffix}", name, count))
    return found


MEASURES: tuple[Measure, ...] = (
    *_top("top-1", "top1"),
    Measure("top1_or_rival", "top-1 or a rival it lists", _cases(in_library, _listed)),
    *_top("ranked first", "ranked", ranked=True),
    Measure("all_found", "all causes found", _cases(in_library, _all_found)),
    Measure("all_found_or_twin", "all found, or twins", _cases(in_library, _all_found_or_twin)),
    Measure("pair_found", "both of two found", _cases(_several, _all_found)),
    Measure("pair_found_or_twin", "both of two, or twins", _cases(_several, _all_found_or_twin)),
    Measure("falsely_added", "named causes that are none", lambda c: _statements(c, c.added), -1),
    Measure(
        "falsely_added_beyond_twins",
        "the same, twins aside",
        lambda c: _statements(c, c.added_beyond_twins),
        -1,
    ),
    Measure("sure_right", "right when > 0.95 sure", lambda c: _sure(c, twins=False)),
    Measure(
        "sure_right_or_twin", "right when > 0.95 sure, or twin", lambda c: _sure(c, twins=True)
    ),
    Measure(
        "false_alarms",
        "false alarms, nothing wrong",
        _cases(lambda c: c.truth.sort is Sort.NONE, lambda c: c.answer.verdict != "no-gap"),
        -1,
    ),
    Measure(
        "missed",
        "gap missed",
        _cases(lambda c: bool(c.truth.causes), lambda c: c.answer.verdict == "no-gap"),
        -1,
    ),
    Measure("outside_hits", "outside: flagged", _cases(outside, lambda c: c.answer.flags_outside)),
    Measure(
        "outside_plain",
        "outside: called outside-library",
        _cases(outside, lambda c: c.answer.verdict == "outside-library"),
    ),
    Measure(
        "outside_named",
        "outside: dependence named",
        _cases(
            lambda c: outside(c) and bool(c.truth.depends_on),
            lambda c: names_dependence(c.truth.depends_on, c.answer),
        ),
    ),
    Measure(
        "outside_wrong_sure",
        "outside: wrong at > 0.95",
        _cases(outside, _wrong_and_sure),
        -1,
    ),
    Measure(
        "beside_found",
        "known cause found beside an unknown",
        _cases(_beside, _known_found),
    ),
    Measure("beside_flagged", "the unknown beside it flagged", _cases(_beside, _flagged)),
    Measure(
        "false_outside",
        "flagged outside without reason",
        _cases(_known_or_nothing, lambda c: c.answer.flags_outside),
        -1,
    ),
    Measure("at_noise_floor", "residual <= 1.1 x sigma", _reaches(floor_of)),
    Measure("at_own_noise", "residual <= 1.1 x these readings' own noise", _at_own_noise),
    Measure("at_own_noise_untimed", "the same, causes that time does not drive", _untimed),
    Measure(
        "unusable",
        "refused or failed",
        _cases(lambda c: True, lambda c: c.answer.verdict in {"refused", "failed"}),
        -1,
    ),
)

"""What is counted: one line a figure, each a share of statements or cases.

A measure says for one case how many of how many it adds; the shares of a group are the sums. Where
a key ends in ``_or_confounded``, an effect that the recording cannot tell from the true one counts
as right.
"""

from collections.abc import Callable
from dataclasses import dataclass
from operator import lt

from plumbline.experiments.withheld.answer import ScoredCase, StatedVerdict
from plumbline.experiments.withheld.truth import Sort
from plumbline.kinematics.effects import REGISTRY

Counted = tuple[int, int]
SURE = 0.95  # probability above which a wrong cause is told for sure
NEAR_FLOOR = 1.1  # times what noise alone leaves: it then makes up for four fifths of the square
PLACES = {"position": ("place of the tip",), "posture": ("posture",), "rows": ("rows ",)}


@dataclass(frozen=True)
class Measure:
    """One figure."""

    key: str  # its name in JSON
    words: str  # its name for people
    count: Callable[[ScoredCase], Counted]  # how many of how many a case adds


Asked = Callable[[ScoredCase], bool]


def in_library(case: ScoredCase) -> bool:
    """Whether something is wrong and the library has all of it."""
    return case.truth.sort in {Sort.SINGLE, Sort.SEVERAL}


def outside(case: ScoredCase) -> bool:
    """Whether the library lacks all that is wrong, and has nothing that looks the same."""
    known = {true for true, _ in case.truth.confounded}
    return case.truth.sort is Sort.OUTSIDE and not known & set(case.truth.causes)


def names_dependence(depends_on: tuple[str, ...], answer: StatedVerdict) -> bool:
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


def floor_of(case: ScoredCase) -> float | None:
    """What noise alone would leave: sigma per reading, root 3 sigma for a distance in space."""
    return _per_point(case, case.truth.noise_std)


def _per_point(case: ScoredCase, sigma: float | None) -> float | None:
    return None if sigma is None else sigma * (3.0**0.5 if case.answer.unit == "m" else 1.0)


def _share(key: str, words: str, over: Asked, hit: Asked) -> Measure:
    """Count cases: those of a kind, and those among them that are hit."""
    return Measure(key, words, lambda case: (int(hit(case)), 1) if over(case) else (0, 0))


def _first(key: str, words: str, *, ranked: bool = False) -> list[Measure]:
    """Four measures of the first answer: effect or element, strictly or with what is confounded."""
    found = []
    for element, what in ((False, "effect"), (True, "element")):
        for either, suffix in ((False, ""), (True, "_or_confounded")):

            def hit(case: ScoredCase, element: bool = element, either: bool = either) -> bool:
                answer = case.answer.ranked_first if ranked else case.answer.first
                fits = case.fits if element else case.effect_fits
                return answer is not None and fits(answer, confounded=either)

            name = f"{words} effect" + (" + element" if element else "")
            name += ", or confounded" if either else ""
            found.append(_share(f"{key}_{what}{suffix}", name, in_library, hit))
    return found


def _listed(case: ScoredCase) -> bool:
    """Whether a true cause is the first answer or among what the verdict says it may be instead."""
    causes = case.answer.causes[:1]
    return any(case.fits(key, confounded=False) for c in causes for key in (c.key, *c.rivals))


def _found(*, confounded: bool, more: Asked = in_library) -> tuple[Asked, Asked]:
    """All causes of a case, or what they are confounded with, were named."""

    def hit(case: ScoredCase) -> bool:
        found = case.found_or_confounded if confounded else case.found
        return found == len(case.truth.causes)

    return more, hit


def _added(case: ScoredCase, found: int) -> Counted:
    """Causes added among causes named, where something known or nothing is wrong."""
    named = len(case.answer.causes)
    return (named - found, named) if case.truth.sort is not Sort.OUTSIDE else (0, 0)


def _sure(case: ScoredCase, *, confounded: bool) -> Counted:
    sure = [s.key for s in case.answer.causes if s.probability > SURE]
    return sum(case.fits(key, confounded=confounded) for key in sure), len(sure)


def _reaches(floor_of: Callable[[ScoredCase], float | None], case: ScoredCase) -> Counted:
    """Whether what is left on rows kept back comes near a floor."""
    floor, after = floor_of(case), case.answer.after
    if not in_library(case) or floor is None or after is None:
        return 0, 0
    return int(after <= NEAR_FLOOR * floor), 1


def _at_own_noise(case: ScoredCase) -> Counted:
    return _reaches(lambda c: _per_point(c, c.truth.noise_rms), case)


def _untimed(case: ScoredCase) -> Counted:
    """The same of causes that time does not drive.

    A bump within a stretch that is left out cannot be told from the rows around it.
    """
    effects = [REGISTRY[name] for name, _ in case.truth.causes if name in REGISTRY]
    timed = any(effect.runs_with_time() for effect in effects)
    return (0, 0) if timed else _at_own_noise(case)


def _known_found(case: ScoredCase) -> bool:
    named = {statement.key for statement in case.answer.causes}
    likes = [{c, *(r for true, r in case.truth.confounded if true == c)} for c in case.truth.known]
    return any(named & like for like in likes)


def _of(*sorts: Sort) -> Asked:
    return lambda case: case.truth.sort in sorts


def _says(*verdicts: str) -> Asked:
    return lambda case: case.answer.verdict in verdicts


def _joint_first(case: ScoredCase) -> bool:
    own = {(stage, j) for stage in ("joint", "actuation") for j in case.truth.joints}
    return bool(own & set(case.answer.places[:1]))


_none, _partly = _of(Sort.NONE), _of(Sort.PARTLY)
MEASURES: tuple[Measure, ...] = (
    *_first("top1", "top-1"),
    _share("top1_or_rival", "top-1 or a rival it lists", in_library, _listed),
    *_first("ranked", "ranked first", ranked=True),
    _share("all_found", "all causes found", *_found(confounded=False)),
    _share("all_found_or_confounded", "all found, or confounded", *_found(confounded=True)),
    _share("pair_found", "both of two found", *_found(confounded=False, more=_of(Sort.SEVERAL))),
    _share("pair_found_or_confounded", "both of two, or confounded",
           *_found(confounded=True, more=_of(Sort.SEVERAL))),
    Measure("falsely_added", "named causes that are none", lambda c: _added(c, c.found)),
    Measure("falsely_added_beyond_confounded", "the same, confounded aside",
            lambda c: _added(c, c.found_or_confounded)),
    Measure("sure_right", "right when > 0.95 sure", lambda c: _sure(c, confounded=False)),
    Measure("sure_right_or_confounded", "right when > 0.95 sure, or confounded",
            lambda c: _sure(c, confounded=True)),
    _share("false_alarms", "false alarms, nothing wrong", _none, lambda c: not _says("no-gap")(c)),
    _share("missed", "gap missed", lambda c: bool(c.truth.causes), _says("no-gap")),
    _share("outside_hits", "outside: flagged", outside, lambda c: c.answer.flags_outside),
    _share("outside_plain", "outside: called outside-library", outside, _says("outside-library")),
    _share("outside_named", "outside: dependence named",
           lambda c: outside(c) and bool(c.truth.depends_on),
           lambda c: names_dependence(c.truth.depends_on, c.answer)),
    _share("outside_joint", "outside: its own joint first",
           lambda c: outside(c) and bool(c.truth.joints), _joint_first),
    _share("outside_wrong_sure", "outside: wrong at > 0.95", outside,
           lambda c: lt(*_sure(c, confounded=True))),
    _share("partly_found", "known cause found with an unknown one", _partly, _known_found),
    _share("partly_flagged", "the unknown one with it flagged", _partly,
           lambda c: c.answer.flags_outside),
    _share("false_outside", "flagged outside without reason",
           lambda c: in_library(c) or _none(c), lambda c: c.answer.flags_outside),
    Measure("at_noise_floor", "residual <= 1.1 x sigma", lambda c: _reaches(floor_of, c)),
    Measure("at_own_noise", "residual <= 1.1 x these readings' own noise", _at_own_noise),
    Measure("at_own_noise_untimed", "the same, causes that time does not drive", _untimed),
    _share("unusable", "refused or failed", lambda c: True, _says("refused", "failed")),
)  # fmt: skip

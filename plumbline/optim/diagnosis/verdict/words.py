"""Findings in words: causes, ripples, places, and the sentences of a verdict."""

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.core.quantities import (
    chance,
    counted,
    enumerated,
    measured,
    percent,
    quantity,
    significant,
)
from plumbline.optim.diagnosis import findings
from plumbline.optim.diagnosis.constants import LISTED, MOST_PLACES, SHOWN
from plumbline.optim.diagnosis.posterior.evidence import Candidate
from plumbline.optim.diagnosis.prior import PART_OF_UNLISTED

ORDER = re.compile(r"order (\S+) (sine|cosine)")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
MANY = {"it": "them", "its": "their", "needs": "need", "is always": "are always"}
ONE = re.compile(rf"\b({'|'.join(sorted(MANY, key=len, reverse=True))})\b")  # said of one effect
SEVERAL = ("joint", "link")  # stages that an arm has more than once
VERBS = (
    " depends on ",
    " changes ",
    " explains ",
    " is missed by ",
)  # of an unknown that is told in a sentence


@dataclass(frozen=True)
class Ripple:
    """One order of a periodic error."""

    order: float  # periods per turn
    amplitude: float  # its size [unit]
    std: float  # standard error of its size [unit]
    unit: str  # the unit


def blame_of(key: findings.Key, candidates: Iterable[Candidate] = ()) -> findings.Blame:
    """A cause by its key; its ``label`` is for example ``backlash of joint 2``.

    Args:
        key: Its effect and element.
        candidates: Where to look for an effect that is not in the package's own library.
    """
    if key[0] in REGISTRY:
        return findings.Blame(key[0], str(REGISTRY[key[0]].stage), key[1])
    stages = (str(c.effect.stage) for c in candidates if c.key == key)
    return findings.Blame(key[0], next(stages, ""), key[1])


def estimate_words(estimate: findings.Estimate) -> str:
    """Value, standard error and unit of a parameter, and whether it rests on its bound."""
    if estimate.at_bound:
        return f"{quantity(estimate.value, estimate.unit)}, at its bound"
    said = measured(estimate.value, estimate.std, estimate.unit)
    return said if estimate.determined else f"not determined (taken as {said})"


def variants_words(variants: Iterable[str]) -> str:
    """``orders 1 and 2; in run-2, order 3; stiffening``: every order of a ripple once a place."""
    orders: dict[str, set[str]] = {}
    others = []
    for one in dict.fromkeys(filter(None, variants)):
        place, order, numbers = one.rpartition("order")
        if order and (not place or place.endswith(", ")):
            orders.setdefault(place, set()).update(NUMBER.findall(numbers))
        else:
            others.append(one)
    said = (
        f"{place}order{'s' if len(found) > 1 else ''} {enumerated(sorted(found, key=float))}"
        for place, found in orders.items()
    )
    return "; ".join([*said, *others])


def without_words(cause: findings.Cause) -> str:
    """How much more of the gap is left without a cause, all else kept."""
    ratio = cause.before / cause.after if cause.after > 0.0 else math.nan
    if not math.isfinite(ratio):
        return ""
    return f"without it {significant(ratio, 3 if ratio < 2.0 else 2)} times as much is left"


def cause_words(cause: findings.Cause) -> str:
    """What a cause means, and which of its forms it is where the sentence does not say so."""
    return f"{cause.words} ({cause.variant})" if cause.variant else cause.words


def ripples(cause: findings.Cause) -> tuple[Ripple, ...]:
    """The orders of a periodic cause, largest first; none where it has no numbered orders."""
    parts: dict[str, dict[str, findings.Estimate]] = {}
    for name, estimate in cause.parameters.items():
        match = ORDER.fullmatch(name)
        if match:
            parts.setdefault(match[1], {})[match[2]] = estimate
    found = [_ripple(order, tuple(pair.values())) for order, pair in parts.items()]
    return tuple(sorted(found, key=lambda ripple: -ripple.amplitude))


def _ripple(order: str, pair: Sequence[findings.Estimate]) -> Ripple:
    """Amplitude of a sine and a cosine; its error to first order."""
    try:
        turns = float(order)
    except ValueError:
        turns = math.nan
    size = math.hypot(*(part.value for part in pair))
    slope = math.hypot(*(part.value * part.std for part in pair))
    std = slope / size if size > 0.0 else math.hypot(*(part.std for part in pair))
    return Ripple(turns, size, std, pair[0].unit)


def ripple_words(found: Sequence[Ripple]) -> str:
    """``42 orders; the strongest 17, 34, 8 per turn, of 0.0420 mrad and less``."""
    named = ", ".join(f"{ripple.order:g}" for ripple in found[:LISTED])
    size = quantity(found[0].amplitude, found[0].unit)
    if len(found) == 1:
        return f"order {named} per turn, amplitude {size}"
    most = "the strongest " if len(found) > LISTED else ""
    return f"{len(found)} orders; {most}{named} per turn, of {size} and less"


def parameter_name(name: str, variant: str) -> str:
    """``order 17 sine``, or ``compliance, by the measured effort``, where variants need telling."""
    if variant.startswith("orders"):  # one with its overtone: each number says which it is of
        base, overtone = NUMBER.findall(variant)[:2]
        twice = name.endswith("_twice")
        return f"order {overtone if twice else base} {name.removesuffix('_twice')}"
    if variant.startswith("order"):
        return f"{variant} {name}"
    return f"{name}, {variant}" if variant else name


def plain_parameters(cause: findings.Cause) -> dict[str, findings.Estimate]:
    """Parameters that belong to no numbered order."""
    return {name: e for name, e in cause.parameters.items() if not ORDER.fullmatch(name)}


def merged(blames: Iterable[findings.Blame], *, why: bool = True) -> tuple[str, ...]:
    """One line an effect and reason: ``backlash of joints 1, 2, 3: no approach side recorded``.

    Reasons that differ in a number alone are one reason, with the largest of the numbers; effects
    of the same places for the same reason are one line.
    """
    found: dict[tuple[str, str, str], list[findings.Blame]] = {}
    for blame in blames:
        reason = NUMBER.sub("#", blame.why) if why else ""
        found.setdefault((blame.effect, blame.stage, reason), []).append(blame)
    if not why:
        return tuple(f"{alike[0].effect}{_places(alike)}" for alike in found.values())
    lines: dict[tuple[str, str], list[findings.Blame]] = {}
    for (_, _, reason), alike in found.items():
        lines.setdefault((_places(alike), reason), []).extend(alike)
    return tuple(_line(place, alike) for (place, _), alike in lines.items())


def _places(alike: Sequence[findings.Blame]) -> str:
    numbers = sorted({blame.element for blame in alike if blame.element is not None})
    noun = findings.NOUNS.get(alike[0].stage, "element")
    listed = ", ".join(map(str, numbers))
    return f" of {noun}{'s' if len(numbers) > 1 else ''} {listed}" if numbers else ""


def _line(place: str, alike: Sequence[findings.Blame]) -> str:
    effects = tuple(dict.fromkeys(blame.effect for blame in alike))
    reason = _one_reason([blame.why for blame in alike])
    if len(effects) > 1:
        reason = ONE.sub(lambda found: MANY[found[0]], reason)
    return f"{', '.join(effects)}{place}{': ' if reason else ''}{reason}"


def _one_reason(reasons: Sequence[str]) -> str:
    if len(set(reasons)) == 1:
        return reasons[0]
    largest = max((number for r in reasons for number in NUMBER.findall(r)), key=float)
    return NUMBER.sub(f"at most {largest}", reasons[0], count=1)


def place_words(stage: str, element: int | None) -> str:
    """``joint 2``, ``drive 2``; ``all joints``; the stage where an arm has one alone."""
    if element is None:
        return f"all {stage}s" if stage in SEVERAL else stage
    return f"{findings.NOUNS.get(stage, stage)} {element}"


def tree_lines(verdict: findings.Verdict) -> tuple[str, ...]:
    """The tree in a line a place: ``joint 2 > 99 %: own angle 98 % (joint_scale 96 %, unlisted)``.

    Most probable first; a single branch has its parent's probability, which is not said twice.
    What may be at work together is told by how probable each is at all, as causes are: two that
    are both sure say so, though each has half of the place's probability.
    """
    shown = [place for place in verdict.tree if place["probability"] >= SHOWN]
    lines = [_place_line(place) for place in shown[:MOST_PLACES]]
    if others := ", ".join(map(_place_chance, shown[MOST_PLACES:])):
        lines.append(f"elsewhere: {others}")
    return tuple(lines)


def _place_line(place: dict[str, Any]) -> str:
    branches = _branches(place["dependences"], "on", lambda b: _mechanisms(b["mechanisms"]))
    return f"{_place_chance(place)}: {', '.join(branches)}"


def _place_chance(place: dict[str, Any]) -> str:
    return f"{place_words(place['stage'], place['element'])} {chance(place['probability'])}"


def _mechanisms(found: Sequence[dict[str, Any]]) -> str:
    """What may depend on it so: effects, and what the library lacks."""
    return f" ({', '.join(_branches(found, 'effect', lambda _: ''))})"


def _branches(
    found: Sequence[dict[str, Any]], name: str, inside: Callable[[dict[str, Any]], str]
) -> list[str]:
    shown = [b for b in found if b["probability"] >= SHOWN] or list(found[:1])
    # How probable a branch is at all; its share, in answers that were stored without.
    sure = [float(b.get("inclusion", b["probability"])) for b in shown]
    told = [f" {chance(p)}" if len(shown) > 1 else "" for p in sure]
    called = [{None: "unlisted", "nothing": "constant"}.get(b[name], b[name]) for b in shown]
    return [f"{c}{p}{inside(b)}" for c, p, b in zip(called, told, shown, strict=True)]


def shared_words(verdict: findings.Verdict) -> str:
    """Why many causes are named with one probability, where something unlisted sets it."""
    most = [1.0 - PART_OF_UNLISTED**apart for apart in (1, 2)]
    found = ([c for c in verdict.causes if abs(c.probability - p) < SHOWN] for p in most)
    alike = max(found, key=len)
    if len(alike) < LISTED or verdict.outside_probability < most[0]:
        return ""
    return (
        f"{len(alike)} causes stand at {chance(alike[0].probability)}: something unlisted is at "
        "work as well, and each of them may be a part of it"
    )


def sensitivity_words(cause: findings.Cause) -> str:
    """Between what its probability is if every prior odds were a third, or three times as high."""
    if cause.sensitivity is None:
        return ""
    low, high = (chance(p) for p in cause.sensitivity)
    if low == high:
        return ""
    return f"{low} to {high} with prior odds a third to three times as high"


def noise_words(noise: findings.NoiseLevel, unit: str) -> str:
    """How large the noise of one axis or one joint is, and where that is known from."""
    source = {
        "given": "as the recording states",
        "repeats": "estimated from repeated readings",
        "fit": "estimated from what the fit leaves",
    }.get(noise.source, noise.source)
    of = "axis" if unit == "m" else "joint"
    return f"{quantity(noise.sigma, unit)} per {of} (1 sigma), {source}"


def gap_words(verdict: findings.Verdict) -> str:
    """The finding in one or two sentences."""
    gap = verdict.gap
    before, after, floor = (quantity(v, gap.unit) for v in (gap.before, gap.after, gap.noise_floor))
    if not verdict.knows_noise:
        left = f"; with {held_words(verdict)} in it, by {after}" if verdict.causes else ""
        unknown = "No noise is stated, so how far it could shrink is not known."
        return f"The model misses by {before}{left}. {unknown}"
    if verdict.verdict == findings.Outcome.NO_GAP:
        return f"The model misses by {before}; noise alone would give {floor}."
    if not verdict.causes:
        return f"The model misses by {before}, where noise alone would give {floor}."
    return (
        f"The model misses by {before}; with {held_words(verdict)} in it, by {after}. "
        f"Noise alone would give {floor}."
    )


def held_words(verdict: findings.Verdict) -> str:
    """``2 causes and 13 unnamed effects``: what the model holds that leaves the gap after."""
    labels = {cause.label for cause in verdict.causes}
    steps = {step.label for step in verdict.staircase} - labels  # of a motion they are drives
    others = len(steps & {candidate.label for candidate in verdict.candidates})
    both = (counted(len(labels), "cause"), len(labels)), (counted(others, "unnamed effect"), others)
    return " and ".join(words for words, number in both if number) or "no cause"


def floor_words(verdict: findings.Verdict) -> str:
    """What the floor of the gap is."""
    return "noise alone" if verdict.knows_noise else "what the fit itself leaves"


def shrink_words(verdict: findings.Verdict) -> str:
    """How far the gap shrinks, with its interval."""
    gap = verdict.gap
    low, high = gap.shrink_ci95
    words = f"The gap shrinks by {percent(gap.shrink)}"
    if math.isfinite(low) and math.isfinite(high):
        words += f" (95 % interval {percent(low)} to {percent(high)})"
    if math.isfinite(gap.removable):
        words += f", {percent(min(gap.removable, 1.0))} of what noise leaves to remove"
    if gap.after == gap.before:
        words = "No effect of the library is in the model"
    by = {
        "motions": "whole motions",
        "groups": "whole groups",
        "time": "stretches of time",
        "workspace": "blocks of space",
    }
    held = by.get(gap.held_out_by, gap.held_out_by)
    if gap.rotation:  # of poses, whose turns the gap of their places does not show
        before, after = (quantity(v, "rad") for v in (gap.rotation.before, gap.rotation.after))
        words += f"; the tool is turned by {before} before and {after} after"
    return f"{words}; every figure is of rows that the fit has not seen ({held} left out)."


def left_over(depends_on: str) -> str:
    """What the unknown depends on, as a sentence, which it may be already."""
    alike, comma, rest = depends_on.partition(", ")
    if comma and alike.startswith("nearly as "):
        depends_on = f"{rest}, {alike}"
    sentence = any(verb in depends_on for verb in VERBS)
    return f"what is left: {depends_on}" if sentence else f"what is left depends on {depends_on}"


def what_to_vary(depends_on: str) -> str:
    """The thing alone that the unknown depends on; none where it is not one thing."""
    thing = depends_on.rpartition(" depends on ")[2]
    return "" if any(verb in thing for verb in VERBS) else thing

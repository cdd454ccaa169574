"""The tree of a verdict: place, dependence, mechanism."""

from collections.abc import Mapping
from typing import Any

from plumbline.optim.diagnosis.posterior.parts import Mechanism
from plumbline.optim.diagnosis.prior import LEAST_TOLD

Place = tuple[str, int | None]


def tree_of(
    places: Mapping[Place, float],
    mechanisms: Mapping[Mechanism, float],
    moved: Mapping[Place, float] | None = None,
) -> tuple[dict[str, Any], ...]:
    """Place, dependence, mechanism: probabilities add up from each level to the one above.

    Where several mechanisms of a place may be at work together, each has its share of the place's
    probability; ``inclusion`` is the probability that it is at work at all, alone or not. What the
    mechanisms together lack of the place's probability is a part of what the library lacks: listed
    terms may stand for it.

    The most probable comes first; of places that are as probable, to what chains repeat, the one
    that moves more, and of mechanisms the one that was given first.

    Args:
        places: Probability of each place, any mechanism there.
        mechanisms: Probability of each mechanism; its effect is None where the library lacks it.
        moved: Square that what is at work at each place moves, in any unit.
    """
    found: list[dict[str, Any]] = []
    most = moved or {}

    def rank(item: tuple[Place, float]) -> tuple[int, float, str]:
        return -round(item[1] / LEAST_TOLD), -most.get(item[0], 0.0), str(item[0])

    ranked = sorted(places.items(), key=rank)
    for (stage, element), p in ranked:
        if stage and p >= LEAST_TOLD:
            own = {m: q for m, q in mechanisms.items() if m[:2] == (stage, element)}
            place = {"stage": stage, "element": element, "probability": p}
            found.append(place | {"dependences": _dependences(own, p)})
    return tuple(found)


def _with_parts(own: Mapping[Mechanism, float], p: float) -> dict[Mechanism, float]:
    """Mechanisms of a place of probability p, what listed ones may stand for among them."""
    found = dict(own)
    listed = {m: q for m, q in own.items() if m[3] is not None}
    lacking = max(p - sum(own.values()), 0.0)
    if lacking <= LEAST_TOLD:
        return found
    for (stage, element, on, _), q in listed.items():
        none = stage, element, on, None
        found[none] = found.get(none, 0.0) + lacking * q / sum(listed.values())
    return found


def _dependences(own: Mapping[Mechanism, float], p: float) -> list[dict[str, Any]]:
    own = _with_parts(own, p)
    share = p / max(sum(own.values()), 1e-300)
    by: dict[str, list[dict[str, object]]] = {}
    for mechanism, q in sorted(own.items(), key=lambda item: -round(item[1], 9)):
        leaf: dict[str, object] = {"effect": mechanism[3], "probability": q * share, "inclusion": q}
        by.setdefault(mechanism[2], []).append(leaf)
    totals = {on: sum(own[m] for m in own if m[2] == on) for on in by}
    return [
        {
            "on": on,
            "probability": totals[on] * share,
            "inclusion": min(totals[on], p),  # of any of them: at most, exact if never together
            "mechanisms": by[on],
        }
        for on in sorted(by, key=lambda on: -totals[on])
    ]

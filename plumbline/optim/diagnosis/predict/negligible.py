"""Practical equivalence: causes without which rows left out are missed by no more.

With many rows everything is significant. A cause that changes the held-out figure by less than a
stated share is there, perhaps, but is not why the robot misses: it is listed, not named.
"""

from collections.abc import Collection, Sequence

from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.predict.held_out import square_with, squares_without


def worth_while(
    selected: SelectedModel, chosen: Sequence[SelectedTerm], named: Collection[Key]
) -> list[SelectedTerm]:
    """The terms without negligible effects: of those that are not named, then of all.

    The slighter half goes at a time: two that are confounded must not both go because each is
    dispensable while the other is there. And together they must be negligible: of small causes
    each of which can be spared, but not all, as many stay as the figure needs.
    """
    variance = selected.selection.variance(chosen)
    limit = (1 + prior.NEGLIGIBLE_RISE) ** 2 * square_with(selected.pool, chosen, variance)
    kept = list(chosen)
    for settled in (named, ()):
        while keys := [k for k in _negligible(selected, kept, variance) if k not in settled]:
            before, kept = kept, _spared(selected, kept, keys, variance, limit)
            if kept == before:
                break
    return kept


def _negligible(
    selected: SelectedModel, chosen: Sequence[SelectedTerm], variance: float
) -> list[Key]:
    """Causes whose absence makes the held-out RMS worse by less than one per cent, slightest first.

    They are there, perhaps, but are not why the robot misses. Of few rows chance alone makes such
    differences: there the evidence is believed, but for what moves no more than rounding.
    """
    full = max(square_with(selected.pool, chosen, variance), 1e-300)
    candidates, terms = selected.selection.candidates, dict[Key, list[SelectedTerm]]()
    for c in chosen:
        terms.setdefault(candidates[c.index].key, []).append(c)
    left = squares_without(selected.pool, chosen, list(terms.values()), variance)
    rise = {key: square / full for key, square in zip(terms, left, strict=True)}
    chance = prior.HELD_OUT_CHANCE / max(selected.best.gram.count, 1.0)
    least = (1 + prior.NEGLIGIBLE_RISE) ** 2 - chance
    if least <= 1.0:
        removed = max(square_with(selected.pool, [], variance) / full - 1, 0.0)
        return [k for k in rise if abs(rise[k] - 1) < prior.SWALLOWED * removed]
    return sorted((k for k in rise if rise[k] < least), key=lambda k: rise[k])


def _spared(
    selected: SelectedModel,
    chosen: list[SelectedTerm],
    negligible: list[Key],
    variance: float,
    limit: float,
) -> list[SelectedTerm]:
    """The terms without half of the negligible ones, or fewer, as held-out squares let them go."""
    limit = max(limit, square_with(selected.pool, chosen, variance))
    count = (len(negligible) + 1) // 2
    while count:
        fewer = _without(selected, chosen, negligible[:count])
        if square_with(selected.pool, fewer, variance) <= limit:
            return fewer
        count //= 2
    return chosen


def _without(
    selected: SelectedModel, chosen: Sequence[SelectedTerm], keys: Sequence[Key]
) -> list[SelectedTerm]:
    """The terms of other causes."""
    return [c for c in chosen if selected.selection.candidates[c.index].key not in keys]

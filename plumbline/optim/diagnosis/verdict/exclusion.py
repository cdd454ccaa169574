"""Causes that are excluded again: an unknown explains them as well, or rows left out disagree.

Evidence ranks; it can be fooled where the model is incomplete, as small effects then pay for what
is missing. So a cause must also be probable given the best nonparametric rival, and its effect on
rows that were left out must not be negligible.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.core.solvers import Solver
from plumbline.optim.diagnosis.discrepancy.outside import Outside
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import SelectedModel, fit, ridge_of
from plumbline.optim.diagnosis.posterior.selection import (
    SelectionProblem,
    asked_again,
    reconsider,
    restricted,
)
from plumbline.optim.diagnosis.predict.held_out import Evaluation, square_with
from plumbline.optim.diagnosis.prior import (
    HELD_OUT_CHANCE,
    LEAST_INCLUSION,
    LEAST_REMOVED,
    MANY_CAUSES,
    NEGLIGIBLE_RISE,
    NEGLIGIBLE_SHARE,
    SETTLING,
    WORSE,
)
from plumbline.optim.recording.recording import Recording


def exclude(
    selected: SelectedModel,
    outside: Outside,
    recording: Recording,
    weights: Array,
    solver: Solver,
    *,
    gently: bool = True,
    afresh: bool = False,
) -> SelectedModel:
    """The selected model without confounded and negligible effects, refitted if there were any.

    Gently: only the weaker half of the confounded effects goes, as a true cause may be doubted
    together with one and be sure alone. Afresh: other causes may come in, which confounded
    effects have hidden.
    """
    kept = _against_the_unknown(selected, outside, gently)
    gone = selected.selection.keys(selected.chosen) - selected.selection.keys(kept)
    if gone:
        # What was chosen together with a confounded effect may have been shaped by it.
        settle = reconsider if afresh else asked_again
        kept = settle(_free_of(selected, gone), kept)
    for _ in range(SETTLING):
        worthy = _worth_while(selected, kept)
        fewer = selected.selection.keys(kept) - selected.selection.keys(worthy)
        gone |= fewer
        if not fewer:
            break
        kept = asked_again(_free_of(selected, gone), worthy)
    if not gone:
        return selected
    return without_keys(replace(selected, chosen=tuple(kept)), gone, recording, weights, solver)


def _free_of(selected: SelectedModel, keys: Set[Key]) -> SelectionProblem:
    """The selection problem without some causes."""
    banned = np.array([c.key in keys for c in selected.selection.candidates], dtype=bool)
    return restricted(selected.selection, selected.selection.allowed & ~banned)


def borne_out(
    selected: SelectedModel, evaluation: Evaluation, lack_of_fit: bool, floor: float
) -> bool:
    """Whether rows that no selection and no fit has seen bear the causes out.

    A model that leaves much unexplained must at least explain a third of what can be: else its
    effects are but confounded with the unknown. Any model must predict better than the nominal
    one.
    """
    if not selected.chosen:
        return True
    before, after = evaluation.rms_before**2, evaluation.rms_after**2
    if not lack_of_fit:
        return after < before
    return after < before - LEAST_REMOVED * max(before - floor**2, 0.0)


def without_keys(
    selected: SelectedModel, keys: Set[Key], recording: Recording, weights: Array, solver: Solver
) -> SelectedModel:
    """The selected model without some causes, the others refitted."""
    candidates = selected.selection.candidates
    kept = [c for c in selected.chosen if candidates[c.index].key not in keys]
    excluded = selected.excluded | keys
    banned = np.array([c.key in excluded for c in candidates], dtype=bool)
    selection = restricted(selected.selection, selected.selection.allowed & ~banned)
    named = selection.keys(kept)
    # What was found dispensable once is not let in again by a back door: variants only.
    mine = np.array([c.key in named for c in candidates], dtype=bool)
    narrow = restricted(selection, selection.allowed & mine)
    for _ in range(SETTLING):
        before, kept = kept, asked_again(narrow, kept)
        if kept == before:
            break
    effects = [candidates[c.index].effect for c in kept]
    ridge = ridge_of(selection, kept, selected.fixed)
    start = selected.best.by_name
    model, best = fit(
        recording,
        [*selected.fixed, *effects],
        selected.model.nuisance,
        weights,
        solver,
        start,
        ridge,
    )
    return replace(
        selected, model=model, best=best, selection=selection, chosen=tuple(kept), excluded=excluded
    )


def _against_the_unknown(
    selected: SelectedModel, outside: Outside, gently: bool
) -> list[SelectedTerm]:
    """Causes that are more probable than an unknown in their place."""
    candidates = selected.selection.candidates
    if len(selected.selection.keys(selected.chosen)) > MANY_CAUSES:
        return list(selected.chosen)
    falling = sorted((p, str(k), k) for k, p in outside.inclusion.items() if p < LEAST_INCLUSION)
    count = (len(falling) + 1) // 2 if gently else len(falling)
    gone = {key for _, _, key in falling[:count]}
    return [c for c in selected.chosen if candidates[c.index].key not in gone]


def _worth_while(selected: SelectedModel, chosen: Sequence[SelectedTerm]) -> list[SelectedTerm]:
    """The terms without negligible effects.

    Of these the slighter half goes at a time: two that are confounded must not both go because
    each is dispensable while the other is there. And together they must be negligible:
    of small causes each of which can be spared, but not all, as many stay as the figure needs.
    """
    variance = selected.selection.variance(chosen)
    limit = WORSE**2 * square_with(selected.pool, selected.chosen, variance)
    kept = list(chosen)
    while negligible := _negligible(selected, kept, variance):
        before, kept = kept, _spared(selected, kept, negligible, variance, limit)
        if kept == before:
            break
    return kept


def _negligible(
    selected: SelectedModel, chosen: Sequence[SelectedTerm], variance: float
) -> list[Key]:
    """Causes whose absence makes the held-out RMS worse by less than one per cent, slightest first.

    Or that account for less than a two-thousandth of the square that all causes together remove:
    they are there, perhaps, but are not why the robot misses. Of few rows chance alone makes such
    differences: there the evidence is believed.
    """
    full = max(square_with(selected.pool, chosen, variance), 1e-300)
    least = 1 + NEGLIGIBLE_SHARE * max(square_with(selected.pool, [], variance) / full - 1, 0.0)
    least = max(least, (1 + NEGLIGIBLE_RISE) ** 2) - HELD_OUT_CHANCE / max(
        selected.best.gram.count, 1.0
    )
    rise = {
        key: square_with(selected.pool, _without(selected, chosen, [key]), variance) / full
        for key in dict.fromkeys(selected.selection.candidates[c.index].key for c in chosen)
    }
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

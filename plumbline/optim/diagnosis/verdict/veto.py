"""Causes that are struck out again: an unknown explains them as well, or rows left out disagree.

Evidence ranks; it can be fooled where the model is incomplete, as small effects then pay for what
is missing. So a cause must also stand beside the best nonparametric rival, and must make rows that
were left out better by more than a trifle.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.core.solvers import Solver
from plumbline.optim.diagnosis.discrepancy.outside import Outside
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.posterior.reduction import Choice
from plumbline.optim.diagnosis.posterior.search import Found, fit, ridge_of
from plumbline.optim.diagnosis.posterior.selection import (
    Question,
    asked_again,
    reconsider,
    restricted,
)
from plumbline.optim.diagnosis.predict.held_out import Evaluation, square_with
from plumbline.optim.recording.recording import Recording

TRIFLE = 0.01
TRIFLING_SHARE = 5e-4
CHANCE = 20.0  # what chance may add to a held-out square, in units of the noise's
SETTLING = 3
WORSE = 1.05  # ratio of held-out figures at which what was struck out is missed
LEAST_REMOVED = 0.35
LEAST_SUPPORT = 0.5
LEAST_STANDING = 0.5
STRUCK = 0.5  # at most this of what evidence gives to a cause is left once it has been struck out
MANY_CAUSES = 6  # a robot with more has much that is wrong, and then something unknown as well


def strike_out(
    found: Found,
    outside: Outside,
    recording: Recording,
    weights: Array,
    solver: Solver,
    *,
    gently: bool = True,
    afresh: bool = False,
) -> Found:
    """The search's answer without its impostors and trifles, refitted if there were any.

    Gently: only the weaker half of the impostors goes, as a true cause may fall with one beside it
    and stand alone. Afresh: other causes may come in where impostors have hidden them.
    """
    kept = _against_the_unknown(found, outside, gently)
    gone = found.question.keys(found.chosen) - found.question.keys(kept)
    if gone:
        # What stood beside an impostor may have been shaped by it.
        settle = reconsider if afresh else asked_again
        kept = settle(_free_of(found, gone), kept)
    for _ in range(SETTLING):
        worthy = _worth_while(found, kept)
        struck = found.question.keys(kept) - found.question.keys(worthy)
        gone |= struck
        if not struck:
            break
        kept = asked_again(_free_of(found, gone), worthy)
    if not gone:
        return found
    return without_keys(replace(found, chosen=tuple(kept)), gone, recording, weights, solver)


def _free_of(found: Found, keys: Set[Key]) -> Question:
    """The search's question without some causes."""
    banned = np.array([c.key in keys for c in found.question.candidates], dtype=bool)
    return restricted(found.question, found.question.allowed & ~banned)


def borne_out(found: Found, evaluation: Evaluation, misfit: bool, floor: float) -> bool:
    """Whether rows that no choice and no fit has seen bear the causes out.

    A model that leaves much unexplained must at least explain a third of what can be: else its
    effects only ape the unknown one. Any model must predict better than the nominal one.
    """
    if not found.chosen:
        return True
    before, after = evaluation.rms_before**2, evaluation.rms_after**2
    if not misfit:
        return after < before
    return after < before - LEAST_REMOVED * max(before - floor**2, 0.0)


def without_keys(
    found: Found, keys: Set[Key], recording: Recording, weights: Array, solver: Solver
) -> Found:
    """The search's answer without some causes, the others refitted."""
    candidates = found.question.candidates
    kept = [c for c in found.chosen if candidates[c.index].key not in keys]
    vetoed = found.vetoed | keys
    banned = np.array([c.key in vetoed for c in candidates], dtype=bool)
    question = restricted(found.question, found.question.allowed & ~banned)
    named = question.keys(kept)
    # What was found dispensable once is not let in again by a back door: variants only.
    mine = np.array([c.key in named for c in candidates], dtype=bool)
    narrow = restricted(question, question.allowed & mine)
    for _ in range(SETTLING):
        before, kept = kept, asked_again(narrow, kept)
        if kept == before:
            break
    effects = [candidates[c.index].effect for c in kept]
    ridge = ridge_of(question, kept, found.fixed)
    start = found.best.by_name
    model, best = fit(
        recording, [*found.fixed, *effects], found.model.nuisance, weights, solver, start, ridge
    )
    return replace(
        found, model=model, best=best, question=question, chosen=tuple(kept), vetoed=vetoed
    )


def _against_the_unknown(found: Found, outside: Outside, gently: bool) -> list[Choice]:
    """Causes that are more probable than an unknown in their place."""
    candidates = found.question.candidates
    if len(found.question.keys(found.chosen)) > MANY_CAUSES:
        return list(found.chosen)
    falling = sorted((p, str(k), k) for k, p in outside.standing.items() if p < LEAST_STANDING)
    count = (len(falling) + 1) // 2 if gently else len(falling)
    gone = {key for _, _, key in falling[:count]}
    return [c for c in found.chosen if candidates[c.index].key not in gone]


def _worth_while(found: Found, chosen: Sequence[Choice]) -> list[Choice]:
    """The choices without trifles.

    Of the trifles the slighter half goes at a time: two that stand in for each other must not both
    go because each is dispensable while the other is there. And together they must be a trifle:
    of small causes each of which can be spared, but not all, as many stay as the figure needs.
    """
    variance = found.question.variance(chosen)
    limit = WORSE**2 * square_with(found.pool, found.chosen, variance)
    kept = list(chosen)
    while trifles := _trifles(found, kept, variance):
        before, kept = kept, _spared(found, kept, trifles, variance, limit)
        if kept == before:
            break
    return kept


def _trifles(found: Found, chosen: Sequence[Choice], variance: float) -> list[Key]:
    """Causes whose absence makes the held-out RMS worse by less than one per cent, slightest first.

    Or that account for less than a two-thousandth of the square that all causes together remove:
    they are there, perhaps, but are not why the robot misses. Of few rows chance alone makes such
    differences: there the evidence is believed.
    """
    full = max(square_with(found.pool, chosen, variance), 1e-300)
    least = 1 + TRIFLING_SHARE * max(square_with(found.pool, [], variance) / full - 1, 0.0)
    least = max(least, (1 + TRIFLE) ** 2) - CHANCE / max(found.best.gram.count, 1.0)
    rise = {
        key: square_with(found.pool, _without(found, chosen, [key]), variance) / full
        for key in dict.fromkeys(found.question.candidates[c.index].key for c in chosen)
    }
    return sorted((k for k in rise if rise[k] < least), key=lambda k: rise[k])


def _spared(
    found: Found, chosen: list[Choice], trifles: list[Key], variance: float, limit: float
) -> list[Choice]:
    """The choices without half of the trifles, or fewer, as far as held-out squares let them go."""
    limit = max(limit, square_with(found.pool, chosen, variance))
    count = (len(trifles) + 1) // 2
    while count:
        fewer = _without(found, chosen, trifles[:count])
        if square_with(found.pool, fewer, variance) <= limit:
            return fewer
        count //= 2
    return chosen


def _without(found: Found, chosen: Sequence[Choice], keys: Sequence[Key]) -> list[Choice]:
    """The choices of other causes."""
    return [c for c in chosen if found.question.candidates[c.index].key not in keys]

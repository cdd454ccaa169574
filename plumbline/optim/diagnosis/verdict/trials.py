"""The trials that causes must stand: against an unknown dependence, and on rows left out.

Each strikes causes out, and each may strike out too much; what was struck out comes back where its
absence turns what all rows explain into a riddle.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from plumbline.optim.diagnosis.discrepancy.outside import Outside, look_beyond
from plumbline.optim.diagnosis.posterior.noise import noise_of
from plumbline.optim.diagnosis.posterior.search import Found
from plumbline.optim.diagnosis.posterior.task import LONG, Task
from plumbline.optim.diagnosis.predict.held_out import Evaluation, evaluate, keys_of, square_with
from plumbline.optim.diagnosis.verdict.lack_of_fit import misfit
from plumbline.optim.diagnosis.verdict.probabilities import probabilities_of
from plumbline.optim.diagnosis.verdict.veto import (
    LEAST_STANDING,
    LEAST_SUPPORT,
    MANY_CAUSES,
    WORSE,
    borne_out,
    strike_out,
    without_keys,
)
from plumbline.optim.recording.recording import Recording

MOST_TESTS = 5
SURE = 0.9  # probability of a lone cause that rows left out need not bear out
STRONG = 3.0  # log odds that are strong evidence, twenty to one (Kass and Raftery 1995, sec. 3.2)


def against_the_unknown(
    task: Task, found: Found, bad: NDArray[np.bool_], seed: int
) -> tuple[Found, Outside]:
    """Causes that stand against an unknown dependence and on rows left out; and that dependence.

    Nothing is struck out where that leaves a gap which all causes together explain about as well
    as the unknown does: beside them the unknown was in doubt, and only without them it is not.
    """
    weights = np.where(bad, 0.0, 1.0)
    whole, outside = found, look_beyond(found, task.noise, seed)
    beside_all = outside
    turns = MOST_TESTS if len(task.recording) < LONG else 1
    for turn in range(turns):
        gently, afresh = turns - 2 > turn, turn == 0
        struck = strike_out(
            found,
            outside,
            task.recording,
            weights,
            task.refitting,
            gently=gently,
            afresh=afresh,
        )
        if struck is found:
            break
        found, outside = struck, look_beyond(struck, task.noise, seed)
    doubt = max(_beyond(task.recording, whole, beside_all), 0.5)
    riddle = _beyond(task.recording, found, outside) > doubt
    if riddle and _few(whole) and not _beaten(beside_all):
        return whole, beside_all
    # What has withstood the last test stands: of many rows each test would strike something more.
    kept = {k: p for k, p in outside.standing.items() if p >= LEAST_STANDING}
    return found, replace(outside, standing=kept)


def _few(found: Found) -> bool:
    """Whether the causes are so few that they may be all that is wrong."""
    return len(keys_of(found)) <= MANY_CAUSES


def _beaten(outside: Outside) -> bool:
    """Whether there is strong evidence for an unknown, or against a cause in its plain form."""
    least = min(outside.standing.values(), default=1.0)
    return bool(outside.log_odds >= STRONG or least <= expit(-STRONG))


def on_rows_left_out(
    recording: Recording,
    task: Task,
    found: Found,
    outside: Outside,
    bad: NDArray[np.bool_],
    by: str,
    seed: int,
) -> tuple[Found, Outside, Evaluation]:
    """Figures on rows left out; causes that these rows do not bear out are struck out."""
    training, weights = task.recording, np.where(bad, 0.0, 1.0)
    evaluation = evaluate(recording, found, task.folds, ~bad, by, seed)
    whole = found, outside, evaluation
    beyond = _beyond(training, found, outside)
    if _is_sure(found, outside, beyond):
        return whole
    flimsy = {key for key, share in evaluation.support.items() if share < LEAST_SUPPORT}
    if flimsy:
        fewer = without_keys(found, flimsy, training, weights, task.refitting)
        seen = evaluate(recording, fewer, task.folds, ~bad, by, seed)
        # Folds that call a cause by other names do not do without it; nor does a verdict whose own
        # causes then fall short of what the folds choose.
        spoilt = not _few(found) and _poorer(fewer, seen)
        if seen.rms_after <= WORSE * evaluation.rms_after and not spoilt:
            found, evaluation = fewer, seen
    floor = noise_of(training, found.best).sigma * evaluation.per_point
    if not borne_out(found, evaluation, _beyond(training, found, outside) > 0.5, floor):
        found = without_keys(found, keys_of(found), training, weights, task.refitting)
        outside = look_beyond(found, task.noise, seed)
        evaluation = evaluate(recording, found, task.folds, ~bad, by, seed)
    # What all rows explain to their noise does not become a riddle because a part of them, without
    # a whole session say, tells too little of it.
    riddle = beyond <= 0.5 < _beyond(training, found, outside)
    return whole if riddle and _few(whole[0]) else (found, outside, evaluation)


def _beyond(training: Recording, found: Found, outside: Outside) -> float:
    """Probability that something is left beyond the causes and the noise."""
    return max(outside.probability, misfit(noise_of(training, found.best), found))


def _is_sure(found: Found, outside: Outside, beyond: float) -> bool:
    """Whether all rows together are sure of one cause, which leaves nothing but noise.

    Part of the rows may then see too little of it to choose it or to predict better with it: of a
    gap below the noise and few rows, chance alone does that.
    """
    if len(keys_of(found)) != 1 or beyond > 0.5:
        return False
    [key] = keys_of(found)
    return probabilities_of(found, outside)[key] >= SURE


def _poorer(found: Found, evaluation: Evaluation) -> bool:
    """Whether the verdict's own causes do worse on rows left out than what the folds choose."""
    own = square_with(found.pool, found.chosen, found.question.variance(found.chosen))
    points = found.best.gram.count / (3.0 if evaluation.per_row else 1.0)
    return bool(np.sqrt(own / points) > WORSE * evaluation.rms_after)

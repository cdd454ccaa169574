"""Model criticism: causes against an unknown dependence, and on rows left out (Box 1980).

Each excludes causes, and each may exclude too many; what was excluded comes back where the model
lacks fit without it, and all rows together do not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from plumbline.optim.diagnosis.discrepancy.outside import Outside, look_beyond
from plumbline.optim.diagnosis.posterior.noise import noise_of
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.posterior.task import Task
from plumbline.optim.diagnosis.predict.held_out import Evaluation, evaluate, keys_of, square_with
from plumbline.optim.diagnosis.prior import (
    LEAST_INCLUSION,
    LEAST_SUPPORT,
    LONG,
    MANY_CAUSES,
    MOST_CHECKS,
    STRONG_EVIDENCE,
    SURE_ALONE,
    WORSE,
)
from plumbline.optim.diagnosis.verdict.exclusion import borne_out, exclude, without_keys
from plumbline.optim.diagnosis.verdict.lack_of_fit import lack_of_fit
from plumbline.optim.diagnosis.verdict.probabilities import probabilities_of
from plumbline.optim.recording.recording import Recording


def against_the_unknown(
    task: Task, selected: SelectedModel, bad: NDArray[np.bool_], seed: int
) -> tuple[SelectedModel, Outside]:
    """Causes that remain given an unknown dependence and on rows left out; and that dependence.

    Nothing is excluded where that leaves a gap which all causes together explain about as well
    as the unknown does: given them the unknown was in doubt, and only without them it is not.
    """
    weights = np.where(bad, 0.0, 1.0)
    whole, outside = selected, look_beyond(selected, task.noise, seed)
    given_all = outside
    turns = MOST_CHECKS if len(task.recording) < LONG else 1
    for turn in range(turns):
        gently, afresh = turns - 2 > turn, turn == 0
        fewer = exclude(
            selected,
            outside,
            task.recording,
            weights,
            task.refitting,
            gently=gently,
            afresh=afresh,
        )
        if fewer is selected:
            break
        selected, outside = fewer, look_beyond(fewer, task.noise, seed)
    doubt = max(_beyond(task.recording, whole, given_all), 0.5)
    lacks_fit = _beyond(task.recording, selected, outside) > doubt
    if lacks_fit and _few(whole) and not _beaten(given_all):
        return whole, given_all
    # What the last test has kept stays: of many rows each test would exclude something more.
    kept = {k: p for k, p in outside.inclusion.items() if p >= LEAST_INCLUSION}
    return selected, replace(outside, inclusion=kept)


def _few(selected: SelectedModel) -> bool:
    """Whether the causes are so few that they may be all that is wrong."""
    return len(keys_of(selected)) <= MANY_CAUSES


def _beaten(outside: Outside) -> bool:
    """Whether there is strong evidence for an unknown, or against a cause in its plain form."""
    least = min(outside.inclusion.values(), default=1.0)
    return bool(outside.log_odds >= STRONG_EVIDENCE or least <= expit(-STRONG_EVIDENCE))


def on_rows_left_out(
    recording: Recording,
    task: Task,
    selected: SelectedModel,
    outside: Outside,
    bad: NDArray[np.bool_],
    by: str,
    seed: int,
) -> tuple[SelectedModel, Outside, Evaluation]:
    """Figures on rows left out; causes that these rows do not bear out are excluded."""
    training, weights = task.recording, np.where(bad, 0.0, 1.0)
    evaluation = evaluate(recording, selected, task.folds, ~bad, by, seed)
    whole = selected, outside, evaluation
    beyond = _beyond(training, selected, outside)
    if _is_sure(selected, outside, beyond):
        return whole
    unsupported = {key for key, share in evaluation.support.items() if share < LEAST_SUPPORT}
    if unsupported:
        fewer = without_keys(selected, unsupported, training, weights, task.refitting)
        seen = evaluate(recording, fewer, task.folds, ~bad, by, seed)
        # Folds that call a cause by other names do not do without it; nor does a verdict whose own
        # causes then fall short of what the folds choose.
        spoilt = not _few(selected) and _poorer(fewer, seen)
        if seen.rms_after <= WORSE * evaluation.rms_after and not spoilt:
            selected, evaluation = fewer, seen
    floor = noise_of(training, selected.best).sigma * evaluation.per_point
    if not borne_out(selected, evaluation, _beyond(training, selected, outside) > 0.5, floor):
        selected = without_keys(selected, keys_of(selected), training, weights, task.refitting)
        outside = look_beyond(selected, task.noise, seed)
        evaluation = evaluate(recording, selected, task.folds, ~bad, by, seed)
    # What all rows explain to their noise does not lack fit because a part of them, without
    # a whole session say, tells too little of it.
    lacks_fit = beyond <= 0.5 < _beyond(training, selected, outside)
    return whole if lacks_fit and _few(whole[0]) else (selected, outside, evaluation)


def _beyond(training: Recording, selected: SelectedModel, outside: Outside) -> float:
    """Probability that something is left beyond the causes and the noise."""
    return max(outside.probability, lack_of_fit(noise_of(training, selected.best), selected))


def _is_sure(selected: SelectedModel, outside: Outside, beyond: float) -> bool:
    """Whether all rows together are sure of one cause, which leaves nothing but noise.

    Part of the rows may then see too little of it to choose it or to predict better with it: of a
    gap below the noise and few rows, chance alone does that.
    """
    if len(keys_of(selected)) != 1 or beyond > 0.5:
        return False
    [key] = keys_of(selected)
    return probabilities_of(selected, outside)[key] >= SURE_ALONE


def _poorer(selected: SelectedModel, evaluation: Evaluation) -> bool:
    """Whether the verdict's own causes do worse on rows left out than what the folds choose."""
    own = square_with(selected.pool, selected.chosen, selected.selection.variance(selected.chosen))
    points = selected.best.gram.count / (3.0 if evaluation.per_row else 1.0)
    return bool(np.sqrt(own / points) > WORSE * evaluation.rms_after)

"""The diagnosis, end to end: distrust, search, hold out, look outside, and say what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from kinematics.effects import EFFECTS, REGISTRY, Effect, Scope, Stage
from optim.diagnosis.evidence import NoisePrior
from optim.diagnosis.folds import fold_of_rows, kind_of_folds
from optim.diagnosis.held_out import (
    Evaluation,
    evaluate,
    figure,
    gap_unit,
    keys_of,
    refitted,
    square_with,
)
from optim.diagnosis.judge import judge, misfit, probabilities_of
from optim.diagnosis.next_experiment import suggestions
from optim.diagnosis.noise import noise_of
from optim.diagnosis.outside import Outside, look_beyond
from optim.diagnosis.robust import distrusted_beside, noise_lever
from optim.diagnosis.search import SOLVER, Found, fit
from optim.diagnosis.slip import slipped_rows
from optim.diagnosis.spectrum import as_spectra
from optim.diagnosis.task import LONG, Task, find_causes
from optim.diagnosis.verdict import Verdict
from optim.diagnosis.veto import (
    LEAST_STANDING,
    LEAST_SUPPORT,
    MANY_CAUSES,
    borne_out,
    strike_out,
    without_keys,
)
from optim.diagnosis.words import in_one_line
from optim.nuisance import nuisances_of
from optim.observation import rotation_lever, scope_of
from optim.problem import Array
from optim.progress import Progress
from optim.recording import Recording
from optim.solution import Solution
from optim.solvers import LevenbergMarquardt, Solver

MOST_TESTS = 5
SURE = 0.9  # probability of a lone cause that rows left out need not bear out
WORSE = 1.05  # ratio of held-out figures at which a cause is missed
ALIKE = 0.1  # log of a ratio of noises that makes no difference
STRONG = 3.0  # log odds that are strong evidence, twenty to one (Kass and Raftery 1995, sec. 3.2)


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """A verdict with what it rests on.

    Attributes:
        recording: The data.
        verdict: What was found.
        residual_before: Held-out residuals of the nominal model (N, m) [gap's unit].
        residual_after: Held-out residuals of the verdict's model (N, m) [gap's unit].
        trusted: Rows (N,) that count.
        places: Tip positions in the base frame (N, 3) [m].
        effects: The effects of the verdict.
        solution: The final fit.
        seed: Of folds, bootstrap and random features.
        found: Where the search ended: what the next experiment starts from.
    """

    recording: Recording
    verdict: Verdict
    residual_before: Array
    residual_after: Array
    trusted: NDArray[np.bool_]
    places: Array
    effects: tuple[Effect, ...]
    solution: Solution
    seed: int
    found: Found

    def transfer(self, other: Recording) -> Transfer:
        """The fitted effects on another recording of the robot, its nuisances alone refitted.

        Left out are effects that belong to the first session (a drift, a bump) and those that need
        a column which the other recording lacks. Ripples of many orders are carried as spectra.
        """
        nuisance, weights = nuisances_of(other), np.ones(len(other))
        _, nominal = fit(other, (), nuisance, weights, LevenbergMarquardt())
        kept_back = self.recording.held_out
        training = self.recording if kept_back is None else self.recording.select(~kept_back)
        carried = as_spectra(training, self.effects, self.solution)
        sizes = [len(e.parameters) for e in carried.effects]
        values = np.split(carried.values, np.cumsum(sizes))
        scope = scope_of(other)
        lasting = [_lasts(e, scope) for e in carried.effects]
        effects = [e for e, kept in zip(carried.effects, lasting, strict=True) if kept]
        held = [v for v, kept in zip(values, lasting, strict=False) if kept]
        after = refitted(other, effects, np.concatenate([np.empty(0), *held]))
        unit, per_row = gap_unit(other)
        before = figure(nominal.mapped.residuals(nominal.x), per_row)
        return Transfer(before, figure(after, per_row), unit)

    def __repr__(self) -> str:
        """The verdict on one line."""
        return f"<Diagnosis of {in_one_line(self.verdict)}>"

    def _repr_html_(self) -> str:
        return self.verdict._repr_html_()


@dataclass(frozen=True)
class Transfer:
    """How a model fitted on one recording does on another, nuisances alone refitted.

    Attributes:
        before: RMS with nuisances alone [unit].
        after: RMS with the effects held at their fitted values [unit].
        unit: ``"m"`` or ``"rad"``.
    """

    before: float
    after: float
    unit: str


def diagnose(
    recording: Recording,
    *,
    held_out_by: str = "auto",
    seed: int = 0,
    solver: Solver | None = None,
    library: Sequence[type[Effect]] = EFFECTS,
    progress: Progress | None = None,
) -> Diagnosis:
    """Say where the gap of a recording lies, which effects cause it and how far it shrinks.

    Args:
        recording: What was recorded.
        held_out_by: What is left out together, see :func:`optim.diagnosis.folds.fold_of_rows`.
        seed: Of folds, bootstrap and random features; the same input gives the same verdict.
        solver: What fits; Levenberg-Marquardt unless given.
        library: Effects to consider.
        progress: Called with what is being done and the share done.

    Raises:
        ValueError: ``held_out_by`` is unknown or needs a column that is not there.
    """
    tell = progress or (lambda words, share: None)
    training = recording if recording.held_out is None else recording.select(~recording.held_out)
    task = Task(
        training,
        fold_of_rows(training, held_out_by, seed),
        NoisePrior.of(training.noise_std),
        always_fitted(training),
        tuple(library),
        solver or SOLVER,
    )
    found, bad = find_causes(task, tell)
    if _lever_unknown(training):
        # What the first search leaves tells how much a rotation's noise counts beside a position's.
        lever = noise_lever(found.best, training)
        if abs(np.log(lever / rotation_lever(training))) > ALIKE:
            training, recording = (replace(r, lever=lever) for r in (training, recording))
            task = replace(task, recording=training)
            found, bad = find_causes(task, tell)
    tell("looking outside of the library", 0.6)
    found, outside = _tested(task, found, bad, seed)
    more = bad | distrusted_beside(found.best, task.noise.sigma)
    if more.sum() > bad.sum() and len(training) < LONG:
        # A cause that was struck out may have been covering for gross rows.
        found, bad = find_causes(task, tell, more)
        found, outside = _tested(task, found, bad, seed)
    tell("leaving rows out", 0.7)
    by = kind_of_folds(training, held_out_by)
    found, outside, evaluation = _held_out(recording, task, found, outside, bad, by, seed)
    tell("weighing the verdict", 0.9)
    noise = noise_of(training, found.best)
    slipped = slipped_rows(found.model, found.best, bad, noise.sigma)
    if len(slipped) and outside.probability < 0.5:
        outside = Outside.slipped(slipped.tolist(), outside.standing)
    verdict = judge(recording, found, evaluation, outside, noise, library, seed)
    verdict = replace(verdict, next=suggestions(found, verdict, seed))
    tell("done", 1.0)
    return _diagnosis(recording, found, evaluation, verdict, seed)


def _lever_unknown(recording: Recording) -> bool:
    stated = recording.noise_std and recording.noise_std_rotation
    return recording.observation == "pose" and not stated


def _tested(task: Task, found: Found, bad: NDArray[np.bool_], seed: int) -> tuple[Found, Outside]:
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


def _held_out(
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
    evaluation = evaluate(recording, training, found, task.folds, ~bad, by, seed)
    whole = found, outside, evaluation
    beyond = _beyond(training, found, outside)
    if _is_sure(found, outside, beyond):
        return whole
    flimsy = {key for key, share in evaluation.support.items() if share < LEAST_SUPPORT}
    if flimsy:
        fewer = without_keys(found, flimsy, training, weights, task.refitting)
        seen = evaluate(recording, training, fewer, task.folds, ~bad, by, seed)
        # Folds that call a cause by other names do not do without it; nor does a verdict whose own
        # causes then fall short of what the folds choose.
        spoilt = not _few(found) and _poorer(fewer, seen)
        if seen.rms_after <= WORSE * evaluation.rms_after and not spoilt:
            found, evaluation = fewer, seen
    floor = noise_of(training, found.best).sigma * evaluation.per_point
    if not borne_out(found, evaluation, _beyond(training, found, outside) > 0.5, floor):
        found = without_keys(found, keys_of(found), training, weights, task.refitting)
        outside = look_beyond(found, task.noise, seed)
        evaluation = evaluate(recording, training, found, task.folds, ~bad, by, seed)
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


def _diagnosis(
    recording: Recording, found: Found, evaluation: Evaluation, verdict: Verdict, seed: int
) -> Diagnosis:
    return Diagnosis(
        recording=recording,
        verdict=verdict,
        residual_before=evaluation.before,
        residual_after=evaluation.after,
        trusted=evaluation.trusted,
        places=recording.chain.placement(recording.q)[:, :3, 3],
        effects=found.effects_of_fit,
        solution=found.best,
        seed=seed,
        found=found,
    )


def _lasts(effect: Effect, scope: Scope) -> bool:
    """Whether an effect of one session can be expected in another one of this scope."""
    of_the_session = effect.stage == Stage.BASE and "time" in effect.needs
    known = effect.name not in REGISTRY or bool(REGISTRY[effect.name].candidates(scope))
    return known and not of_the_session


def always_fitted(recording: Recording) -> tuple[Effect, ...]:
    """Effects that the recording wants in every model, all elements of each."""
    scope = scope_of(recording)
    names = [name for name in recording.always if name in REGISTRY]
    found = [v for name in names for v in REGISTRY[name].candidates(scope)]
    if recording.observation != "joint_position":
        return tuple(found)
    seen = {j + 1 for j in recording.measured_joints}
    return tuple(v for v in found if v.element is None or v.element in seen)

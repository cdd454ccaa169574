"""The diagnosis, end to end: distrust, search, hold out, look outside, and say what was found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError, fault
from plumbline.kinematics.effects import Effect
from plumbline.optim.core.progress import Progress
from plumbline.optim.diagnosis.answer import Diagnosis, nuisances_found
from plumbline.optim.diagnosis.design.next_experiment import suggestions
from plumbline.optim.diagnosis.findings import NoiseLevel, Verdict
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.noise import noise_of
from plumbline.optim.diagnosis.posterior.robust import noise_lever
from plumbline.optim.diagnosis.posterior.search import (
    SelectedModel,
    about_its_fit,
    foretold_wrongly,
)
from plumbline.optim.diagnosis.posterior.task import Task, find_causes
from plumbline.optim.diagnosis.predict.folds import fold_of_rows, kind_of_folds
from plumbline.optim.diagnosis.predict.held_out import Evaluation, evaluate
from plumbline.optim.diagnosis.predict.negligible import worth_while
from plumbline.optim.diagnosis.prior import (
    LEAST_TOLD,
    NO_EVIDENCE,
    ROUNDS,
    SAME_CORRELATION,
    SETTLED_VARIANCE,
)
from plumbline.optim.diagnosis.verdict.explanation import Explanation, explain, with_terms
from plumbline.optim.diagnosis.verdict.judge import judge
from plumbline.optim.diagnosis.verdict.lack_of_fit import lack_of_fit
from plumbline.optim.diagnosis.verdict.own_unit import in_own_unit
from plumbline.optim.diagnosis.verdict.parts import left_open
from plumbline.optim.loading import load_to_diagnose
from plumbline.optim.measurement.correlated import trust
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import rotation_lever, scope_of
from plumbline.optim.measurement.refit import always_fitted
from plumbline.optim.measurement.torque import own_units, stated_noise
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import refuse_wrong_set_up


def diagnose(
    recording: Recording | str | Path,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Diagnosis:
    """Say where the gap of a recording lies, which effects cause it and how far it shrinks.

    Args:
        recording: What was recorded, or the folder of it.
        options: How; see :class:`~plumbline.optim.diagnosis.options.DiagnosisOptions`.
        progress: Called with what is being done and the share done.

    Raises:
        PlumblineError: The folder cannot be used, or another simple set-up explains the rows far
            better: a joint's sign or zero, swapped columns, mirrored axes, another robot; or what
            is held out needs a column that is not there.
    """
    options = options or DiagnosisOptions()
    recording, seed = usable(recording, options.force), options.seed
    tell = progress or (lambda words, share: None)
    task = task_of(recording, options)
    training = task.recording
    selected, bad = find_causes(task, tell)
    if _lever_unknown(training):
        # What the first search leaves tells what a rotation's noise counts against a position's.
        lever = noise_lever(selected.best, training)
        if abs(np.log(lever / rotation_lever(training))) > -np.log(SETTLED_VARIANCE):
            training, recording = (replace(r, lever=lever) for r in (training, recording))
            task = replace(task, recording=training)
            selected, bad = find_causes(task, tell)
    tell("weighing what may be at work", 0.6)
    selected, told = _explained(task, selected, bad, options)
    task, selected, bad, told = _told_apart(task, selected, bad, told, options)
    if task.recording is not training:
        training = task.recording
        recording = replace(recording, wander=training.wander, alike=training.alike)
    tell("leaving rows out", 0.7)
    task, selected, by = _in_between(task, selected, options)
    selected, evaluation = _foretold(recording, task, selected, bad, by, seed)
    tell("putting the verdict together", 0.9)
    noise = noise_of(training, selected.best)
    lacking = _lacking(task, selected, bad, told, noise)
    verdict = judge(recording, selected, evaluation, told, noise, options.effects, seed, lacking)
    verdict = replace(verdict, next=suggestions(selected, verdict, seed))
    if recording.element is not None:
        untold = left_open(selected.nominal, noise.sigma)
        verdict = replace(verdict, notes=(*verdict.notes, *untold))
    verdict = replace(in_own_unit(verdict, recording), unjudged=recording.unjudged)
    tell("done", 1.0)
    return _diagnosis(recording, selected, evaluation, verdict, options)


def _told_apart(
    task: Task,
    selected: SelectedModel,
    bad: NDArray[np.bool_],
    told: Explanation,
    options: DiagnosisOptions,
) -> tuple[Task, SelectedModel, NDArray[np.bool_], Explanation]:
    """All of it again where rows know of each other: then they count for less than they seemed."""
    for _ in range(ROUNDS):
        rows = task.recording
        wander, alike = told.correlation
        if _worth_the_same(wander, rows.wander) and abs(alike - rows.alike) <= SAME_CORRELATION:
            break
        rows = replace(rows, wander=wander, alike=alike)
        folds = fold_of_rows(rows, options.held_out, options.seed)
        task = replace(task, recording=rows, folds=folds)
        selected, bad = find_causes(task, lambda words, share: None, bad)
        selected, told = _explained(task, selected, bad, options)
    return task, selected, bad, told


def _worth_the_same(rho: float, before: float) -> bool:
    """Whether rows of such a noise count for as many as before: (1 - rho) / (1 + rho) of them."""
    kept, was = ((1.0 - r) / (1.0 + r) for r in (rho, before))
    return abs(kept - was) <= SAME_CORRELATION * (kept + was)


def _in_between(
    task: Task, selected: SelectedModel, options: DiagnosisOptions
) -> tuple[Task, SelectedModel, str]:
    """What is left out together: rows in between, where no stretch foretells what is in another.

    Of a bump or a slip the other stretches and groups know neither when nor how far. Rows of
    separate postures resemble each other no more than the causes make them.
    """
    rows = task.recording
    by = kind_of_folds(rows, options.held_out)
    of_stretch = any(e.runs_with_time() or e.depends_on == "group" for e in selected.effects)
    told = options.held_out != "auto" or rows.session is not None or rows.wander > 0.0
    if by != "groups" or told or not of_stretch or scope_of(rows).moving:
        return task, selected, by
    folds = fold_of_rows(rows, "rows", options.seed)
    pool = selected.pool.folded(folds)
    return replace(task, folds=folds), replace(selected, pool=pool), "rows"


def _explained(
    task: Task, selected: SelectedModel, bad: NDArray[np.bool_], options: DiagnosisOptions
) -> tuple[SelectedModel, Explanation]:
    """The model of what is more probable than not and not negligible, and all probabilities.

    All are of one linear problem. Where its fit to what is named is another than it foretold,
    effects that bend each other were linearised too far off: they are anew, about that fit, as
    long as that brings the two nearer to each other by half.
    """
    weights = trust(task.recording, bad)
    given = (task.recording, weights, task.refitting)
    before = np.inf
    for left in reversed(range(ROUNDS)):
        told = explain(selected, options.seed, options.unlisted)
        kept = worth_while(selected, told.terms)
        selected = with_terms(selected, kept, *given, tried=told.terms)
        wrong = foretold_wrongly(selected)
        if not left or wrong < NO_EVIDENCE or wrong > 0.5 * before:
            break
        before = wrong
        selected = about_its_fit(selected, task.library)
    # Of many causes any rival may do nearly as well: folds choose among those of the model, of a
    # long recording among all that its rows show, of which the posterior has seen only a part.
    barred = selected.excluded
    if told.one_by_one:
        shown = told.terms if told.compared else selected.chosen
        every = frozenset(c.key for c in selected.selection.candidates)
        barred = every - selected.selection.keys(shown)
    return replace(selected, barred=barred, states=told.states), told


def _foretold(
    recording: Recording,
    task: Task,
    selected: SelectedModel,
    bad: NDArray[np.bool_],
    by: str,
    seed: int,
) -> tuple[SelectedModel, Evaluation]:
    """The figures of rows left out, and the model: without causes where these only mislead.

    Where what is missing in the model resembles one effect in some rows and another in others, a
    choice that is made without a fold fails in it: such names hang on which rows were recorded.
    """
    found = evaluate(recording, selected, task.folds, ~bad, by, seed)
    if not found.misleads:
        return selected, found
    weights = trust(task.recording, bad)
    selected = with_terms(selected, (), task.recording, weights, task.refitting)
    return selected, evaluate(recording, selected, task.folds, ~bad, by, seed)


def _lacking(
    task: Task,
    selected: SelectedModel,
    bad: NDArray[np.bool_],
    told: Explanation,
    noise: NoiseLevel,
) -> float:
    """Lack of fit of the library: of its most probable terms, named or not.

    Causes that share a probability leave more where none of them is in the model. Where rows left
    out are foretold worse with causes, the library explains nothing.
    """
    lacking = lack_of_fit(noise, selected)
    if lacking < LEAST_TOLD or not told.states or (told.named and not selected.chosen):
        return lacking
    given = (task.recording, trust(task.recording, bad), task.refitting)
    best = with_terms(selected, told.states[0][1], *given)
    return min(lacking, lack_of_fit(noise_of(task.recording, best.best), best))


def usable(recording: Recording | str | Path, force: bool) -> Recording:
    """The recording, read if it is not yet, and refused where another set-up explains it.

    Raises:
        PlumblineError: It cannot be used.
    """
    if not isinstance(recording, Recording):
        recording = load_to_diagnose(recording)
    if not force and recording.session is None:  # of several each was asked on its own
        refuse_wrong_set_up(recording)
    return recording


def task_of(recording: Recording, options: DiagnosisOptions) -> Task:
    """What is to be searched: the rows that may be fitted, and what is always fitted to them."""
    training = recording.training
    always = always_fitted(training)
    _refuse_more_than_rows_tell(training, always)
    folds = fold_of_rows(training, options.held_out, options.seed)
    noise = NoisePrior.of(stated_noise(training))
    return Task(training, folds, noise, always, options.effects, options.solver)


def _lever_unknown(recording: Recording) -> bool:
    stated = recording.noise_std and recording.noise_std_rotation
    stated = stated or recording.session is not None  # whose parts' fits have told it
    return recording.kind.oriented and not stated


def _diagnosis(
    recording: Recording,
    selected: SelectedModel,
    evaluation: Evaluation,
    verdict: Verdict,
    options: DiagnosisOptions,
) -> Diagnosis:
    own = own_units(recording)
    found = Diagnosis(
        recording=recording,
        verdict=verdict,
        residual_before=evaluation.before * own,
        residual_after=evaluation.after * own,
        trusted=evaluation.trusted,
        places=recording.chain.placement(recording.q)[:, :3, 3],
        effects=selected.effects_of_fit,
        stated=selected.model,
        solution=selected.best,
        options=options,
        search=selected,
    )
    return replace(found, verdict=replace(verdict, nuisances=nuisances_found(found)))


def _refuse_more_than_rows_tell(recording: Recording, always: Sequence[Effect]) -> None:
    """Refuse rows that what is always fitted goes through, whatever is wrong with the robot.

    Raises:
        PlumblineError: It names the effect of ``[fit] always`` that takes the most, if any.
    """
    if recording.session is not None:
        return  # each was asked on its own
    taken = Counter[str]()
    for effect in always:
        taken[effect.name] += len(effect.parameters)
    unknowns = nuisances_of(recording).size + taken.total()
    readings = len(recording) * (recording.kind.equations or len(recording.measured_joints))
    if unknowns >= readings and not taken:
        found = f"{readings} readings in {len(recording)} rows to fit"
        more = f"more than {unknowns}, as many as are always fitted"
        raise fault(recording.name, found, more, "record more postures")
    if unknowns >= readings:
        name, most = taken.most_common(1)[0]
        raise PlumblineError(
            f"{recording.name}: [fit] always takes {unknowns} unknowns, {most} of them for {name}, "
            f"and the rows to fit hold {readings} readings; leave it out, or record more rows"
        )

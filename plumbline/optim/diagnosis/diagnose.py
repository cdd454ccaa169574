"""The diagnosis, end to end: distrust, search, hold out, look outside, and say what was found."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from plumbline.errors import PlumblineError, fault
from plumbline.kinematics.effects import Effect
from plumbline.kinematics.evaluate import Flags
from plumbline.optim.core.problem import Array
from plumbline.optim.core.progress import Progress, silent
from plumbline.optim.core.quantities import quantity
from plumbline.optim.core.threads import one_thread
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.answer import Diagnosis, nuisances_found
from plumbline.optim.diagnosis.constants import NOTHING
from plumbline.optim.diagnosis.design.next_experiment import suggestions
from plumbline.optim.diagnosis.findings import Key, Outcome, Verdict
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.noise import noise_of
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.robust import noise_lever
from plumbline.optim.diagnosis.posterior.search import (
    SelectedModel,
    Task,
    find_causes,
)
from plumbline.optim.diagnosis.predict.folds import fold_of_rows, kind_of_folds
from plumbline.optim.diagnosis.predict.held_out import Evaluation, evaluate
from plumbline.optim.diagnosis.verdict.explanation import Explanation
from plumbline.optim.diagnosis.verdict.judge import in_own_unit, judge
from plumbline.optim.diagnosis.verdict.lack_of_fit import is_quieter
from plumbline.optim.diagnosis.verdict.parts import left_open
from plumbline.optim.diagnosis.verdict.settled import settled
from plumbline.optim.diagnosis.verdict.terms import with_terms
from plumbline.optim.loading import load_to_diagnose
from plumbline.optim.measurement.correlated import copied
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import rotation_lever, scope_of
from plumbline.optim.measurement.pose_noise import told_by
from plumbline.optim.measurement.refit import always_fitted
from plumbline.optim.measurement.torque import own_units, stated_noise
from plumbline.optim.measurement.uneven import swings
from plumbline.optim.recording.disagreement import unmet, zeros_by_mounting
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import plausible, refuse_wrong_set_up


@one_thread()
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
    tell = progress or silent
    recording = usable(recording, options.force)
    task, selected, bad = _searched(task_of(recording, options), tell)
    tell("weighing what may be at work", 0.6)
    found = _told_apart(_explained(options, task, selected, bad))
    # The whole recording with what its rows to fit have told of their noise.
    told = ("lever", "pose_spread", "jitter", "wander", "alike", "scatter")
    known = {name: getattr(found.task.recording, name) for name in told}
    recording = replace(recording, **known)
    tell("leaving rows out", 0.7)
    found, evaluation = _foretold(recording, _in_between(found))
    tell("putting the verdict together", 0.9)
    verdict = _judged(recording, found, evaluation)
    if (plain := _without_belied_noise(recording, verdict, found.selected)) is not None:
        return diagnose(plain, options, progress=progress)
    tell("done", 1.0)
    return _diagnosis(recording, found.selected, evaluation, verdict, options)


@dataclass(frozen=True, eq=False)
class Explained:
    """What explains a recording, as far as a diagnosis has come."""

    options: DiagnosisOptions  # how it was asked for
    task: Task  # the rows that may be fitted (N), and how they are searched
    selected: SelectedModel  # the model of what is more probable than not
    bad: Flags  # which of the rows are taken for gross errors (N,)
    explanation: Explanation  # all probabilities
    by: str = ""  # what is left out together


def _searched(task: Task, tell: Progress) -> tuple[Task, SelectedModel, Flags]:
    """What the search finds and distrusts, and the task with what a pose's noise is.

    What a first search leaves tells it; then all is searched again.
    """
    selected, bad = find_causes(task, tell)
    known = _with_pose_noise(task.recording, selected)
    if known is not task.recording:
        task = replace(task, recording=known)
        selected, bad = find_causes(task, tell)
    return task, selected, bad


def _with_pose_noise(rows: Recording, selected: SelectedModel) -> Recording:
    """The rows with what a rotation's noise counts for, and how a pose's place and turn go along.

    The same rows where that is stated, or nearly as it was.
    """
    if not _lever_unknown(rows):
        return rows
    best, before = selected.best, rotation_lever(rows)
    trusted = best.problem.weights > 0.0
    told = told_by(rows.select(trusted), best.mapped.residuals(best.x)[trusted])
    if told.odds > 0.0:
        return replace(rows, lever=before * told.lever, pose_spread=told.spread)
    lever = noise_lever(best, rows)
    settled = abs(np.log(lever / before)) <= -np.log1p(-prior.SETTLED_WITHIN)
    return rows if settled else replace(rows, lever=lever)


def _told_apart(found: Explained) -> Explained:
    """All of it again where rows know of each other: then they count for less than they seemed.

    Where what is then left tells of noise that was assumed before, neither is told by the rows: it
    stays as it was then, at first of rows that know nothing of each other.
    """
    options, asked = found.options, [found]
    for _ in range(prior.ROUNDS):
        rows, told = found.task.recording, found.explanation.correlation
        alike = max(told.alike, float(rows.alike == 1.0))  # copies are known, however few
        rows = replace(rows, wander=told.wander, alike=alike, jitter=told.jitter)
        rows = replace(rows, scatter=np.array(told.scatter) if told.scatter else None)
        for one in reversed(asked):
            if _settled(rows, one.task.recording):
                return one
        folds = fold_of_rows(rows, options.held_out, options.seed)
        task = replace(found.task, recording=rows, folds=folds)
        found = _explained(options, task, *find_causes(task, silent, found.bad))
        asked.append(found)
    return found


def _settled(rows: Recording, before: Recording) -> bool:
    """Whether noise is told of rows nearly as it was before."""
    low, high = sorted((rows.jitter, before.jitter))
    return (
        low**2 >= (1.0 - prior.SETTLED_WITHIN) * high**2
        and _as_loose(before, rows.scatter)
        and abs(rows.alike - before.alike) <= prior.SETTLED_WITHIN
        and _worth_the_same(rows.wander, before.wander)
    )


def _as_loose(rows: Recording, scatter: Array | None) -> bool:
    """Whether joints scatter by nearly as much as these would (n,), as it shows in the rows."""
    if rows.scatter is None or scatter is None:
        return rows.scatter is scatter
    seen = np.mean(swings(rows, rotation_lever(rows)) ** 2, axis=(1, 2))
    off, before = np.abs(scatter**2 - rows.scatter**2) @ seen, rows.scatter**2 @ seen
    return bool(off <= prior.SETTLED_WITHIN * (1.0 + before))


def _worth_the_same(rho: float, before: float) -> bool:
    """Whether rows of such a noise count for as many as before: (1 - rho) / (1 + rho) of them."""
    kept, was = ((1.0 - r) / (1.0 + r) for r in (rho, before))
    return abs(kept - was) <= prior.SETTLED_WITHIN * (kept + was)


def _in_between(found: Explained) -> Explained:
    """What is left out together: rows in between, where no stretch foretells what is in another.

    Of a bump or a slip the other stretches and groups know neither when nor how far. Rows of
    separate postures resemble each other no more than the causes make them.
    """
    options, selected, rows = found.options, found.selected, found.task.recording
    by = kind_of_folds(rows, options.held_out)
    of_stretch = any(e.runs_with_time() or e.depends_on == "group" for e in selected.effects)
    settled = options.held_out != "auto" or rows.several or rows.wander > 0.0
    if by != "groups" or settled or not of_stretch or scope_of(rows).moving:
        return replace(found, by=by)
    folds = fold_of_rows(rows, "rows", options.seed)
    selected = replace(selected, pool=selected.pool.folded(folds))
    return replace(found, task=replace(found.task, folds=folds), selected=selected, by="rows")


def _explained(
    options: DiagnosisOptions, task: Task, selected: SelectedModel, bad: Flags
) -> Explained:
    """The model of what is more probable than not and not negligible, and all probabilities."""
    selected, explanation = settled(task, selected, bad, options.seed, options.unlisted)
    if idle := _idle(selected):
        rest = [t for t in selected.chosen if t not in idle]
        selected = with_terms(selected, rest, task, bad)
    selected = replace(selected, barred=_barred(selected, explanation), states=explanation.states)
    return Explained(options, task, selected, bad, explanation)


def _idle(selected: SelectedModel) -> list[SelectedTerm]:
    """Forms of a cause that a fit within bounds leaves at nothing, given other forms of it."""
    columns = {term.effect: term.columns for term in selected.model.terms}
    size = selected.best.problem.scale

    def idles(term: SelectedTerm) -> bool:
        effect = selected.selection.candidates[term.index].effect
        null = np.array([p.null for p in effect.parameters])
        off = selected.best.x[columns[effect]] - null
        return bool((np.abs(off) <= NOTHING * size[columns[effect]]).all())

    key = [selected.selection.candidates[t.index].key for t in selected.chosen]
    idle = [idles(t) for t in selected.chosen]
    works = {k for k, none in zip(key, idle, strict=True) if not none}
    return [t for t, k, none in zip(selected.chosen, key, idle, strict=True) if none and k in works]


def _barred(selected: SelectedModel, explanation: Explanation) -> frozenset[Key]:
    """Causes that no fold may choose.

    Of many causes any rival may do nearly as well: folds choose among those of the model, of a
    long recording among all that its rows show, of which the posterior has seen only a part.
    """
    if not explanation.one_by_one:
        return selected.excluded
    shown = explanation.terms if explanation.compared else selected.chosen
    every = frozenset(c.key for c in selected.selection.candidates)
    return every - selected.selection.keys(shown)


def _foretold(recording: Recording, found: Explained) -> tuple[Explained, Evaluation]:
    """The figures of rows left out, and the model: without causes where these only mislead.

    Where what is missing in the model resembles one effect in some rows and another in others, a
    choice that is made without a fold fails in it: such names hang on which rows were recorded.
    """
    given = (found.task.folds, ~found.bad, found.by, found.options.seed)
    figures = evaluate(recording, found.selected, *given)
    if figures.misleads:
        found = replace(found, selected=with_terms(found.selected, (), found.task, found.bad))
        figures = evaluate(recording, found.selected, *given)
    return found, figures


def _judged(recording: Recording, found: Explained, evaluation: Evaluation) -> Verdict:
    """The verdict, in the recording's own unit, with what to record next."""
    selected, options = found.selected, found.options
    noise = noise_of(found.task.recording, selected.best)
    verdict = judge(
        recording, selected, evaluation, found.explanation, noise, options.effects, options.seed
    )
    verdict = replace(verdict, next=suggestions(selected, verdict, options.seed))
    if recording.element is not None or recording.kind.device:
        turned = "flange more, and to planes that face other ways"
        turned = "tool more" if recording.element is None else turned
        untold = left_open(selected.nominal, noise.sigma, turned)
        verdict = replace(verdict, notes=(*verdict.notes, *untold))
    verdict = replace(verdict, unmet=unmet(recording), unjudged=recording.unjudged)
    return in_own_unit(verdict, recording, evaluation)


def usable(recording: Recording | str | Path, force: bool) -> Recording:
    """The recording, read if it is not yet, without a noise that no device has.

    Readings that are copies of one another are one. It is refused where another set-up explains it.

    Raises:
        PlumblineError: It cannot be used.
    """
    if not isinstance(recording, Recording):
        recording = load_to_diagnose(recording)
    if not force and not recording.several:  # of several each was asked on its own
        refuse_wrong_set_up(recording)
    recording = zeros_by_mounting(recording)
    if not recording.several and copied(recording):
        recording = replace(recording, alike=1.0)
    if (recording.noise_std or 0.0) > plausible(recording):
        return replace(recording, noise_std=None)
    return recording


def _without_belied_noise(
    r: Recording, verdict: Verdict, selected: SelectedModel
) -> Recording | None:
    """The recording without a stated noise that is larger than all that it is to be told from.

    None where it is not, or where a gap is seen all the same. Efforts have a noise for each drive.
    """
    hidden = verdict.verdict == Outcome.NO_GAP and is_quieter(verdict.noise, selected)
    if not hidden or r.several or r.kind.efforts:
        return None
    sizes = np.array([1.0, verdict.noise.ratio]) * verdict.noise.sigma
    stated, left = (quantity(float(size), r.kind.unit) for size in sizes)
    missed = f"rows miss the model by {left}: the noise is taken from what a fit leaves"
    said = f"noise_std is {stated}, but {missed}"
    return replace(r, noise_std=None, notes=(*r.notes, said))


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
    stated = stated or recording.several  # whose parts' fits have told it
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
    if recording.several:
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

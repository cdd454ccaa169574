"""The diagnosis, end to end: distrust, search, hold out, look outside, and say what was found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import REGISTRY, Effect, Stage
from plumbline.optim.core.judged import Judgement, judged
from plumbline.optim.core.problem import Array
from plumbline.optim.core.progress import Progress
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers import LevenbergMarquardt
from plumbline.optim.diagnosis.design.next_experiment import suggestions
from plumbline.optim.diagnosis.discrepancy.outside import Outside
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.noise import noise_of
from plumbline.optim.diagnosis.posterior.robust import distrusted_given, noise_lever
from plumbline.optim.diagnosis.posterior.search import SelectedModel, fit
from plumbline.optim.diagnosis.posterior.slip import slipped_rows
from plumbline.optim.diagnosis.posterior.spectrum import as_spectra
from plumbline.optim.diagnosis.posterior.task import Task, find_causes
from plumbline.optim.diagnosis.predict.folds import fold_of_rows, kind_of_folds
from plumbline.optim.diagnosis.predict.held_out import Evaluation, figure, gap_unit, refitted
from plumbline.optim.diagnosis.prior import LEVER_ALIKE, LONG
from plumbline.optim.diagnosis.verdict.criticism import against_the_unknown, on_rows_left_out
from plumbline.optim.diagnosis.verdict.judge import judge
from plumbline.optim.diagnosis.verdict.words import blame_of
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model, rotation_lever, scope_of
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import refuse_wrong_set_up

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        options: How it was asked for.
        selected: Where the search ended: what the next experiment starts from.
    """

    recording: Recording
    verdict: Verdict
    residual_before: Array
    residual_after: Array
    trusted: NDArray[np.bool_]
    places: Array
    effects: tuple[Effect, ...]
    solution: Solution
    options: DiagnosisOptions
    selected: SelectedModel

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
        lasting = [_lasts(e, other) for e in carried.effects]
        effects = [e for e, kept in zip(carried.effects, lasting, strict=True) if kept]
        held = [v for v, kept in zip(values, lasting, strict=False) if kept]
        after, ended = refitted(other, effects, np.concatenate([np.empty(0), *held]))
        unit, per_row = gap_unit(other)
        before = figure(nominal.mapped.residuals(nominal.x), per_row)
        went = {(e.name, e.element) for e in effects}
        stays = dict.fromkeys((e.name, e.element) for e in carried.effects)
        left_out = [blame_of(key).label for key in stays if key not in went]
        fits = Judgement.of([judged(nominal, "the fit without causes"), ended])
        return Transfer(before, figure(after, per_row), unit, tuple(left_out), fits)

    def __repr__(self) -> str:
        """The verdict on one line."""
        return f"<Diagnosis of {self.verdict.headline}>"

    def _repr_html_(self) -> str:
        return self.card()

    @property
    def judged(self) -> Judgement:
        """Whether every fit behind the verdict converged."""
        return self.verdict.judged

    def card(self) -> str:
        """The verdict's card of HTML."""
        return self.verdict.card()

    def plot(self) -> Figure:
        """The verdict's picture: the gap as the causes go in, one by one."""
        return self.verdict.plot()

    def to_dict(self) -> dict[str, Any]:
        """The verdict's figures as plain data in SI units."""
        return self.verdict.to_dict()

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Store the verdict, which ``plumbline.Verdict.load`` brings back.

        The fits themselves follow from the recording and the seed.

        Raises:
            PlumblineError: There is a file already, or it cannot be written.
        """
        self.verdict.save(path, overwrite=overwrite)


@dataclass(frozen=True)
class Transfer:
    """How a model fitted on one recording does on another, nuisances alone refitted.

    Attributes:
        before: RMS with nuisances alone [unit].
        after: RMS with the effects held at their fitted values [unit].
        unit: ``"m"`` or ``"rad"``.
        left_out: Causes that were not carried over.
        judged: Whether both fits converged.
    """

    before: float
    after: float
    unit: str
    left_out: tuple[str, ...] = ()
    judged: Judgement = field(default_factory=Judgement)


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
    recording, seed = _usable(recording, options.force), options.seed
    tell = progress or (lambda words, share: None)
    task = _task(recording, options)
    training = task.recording
    selected, bad = find_causes(task, tell)
    if _lever_unknown(training):
        # What the first search leaves tells what a rotation's noise counts against a position's.
        lever = noise_lever(selected.best, training)
        if abs(np.log(lever / rotation_lever(training))) > LEVER_ALIKE:
            training, recording = (replace(r, lever=lever) for r in (training, recording))
            task = replace(task, recording=training)
            selected, bad = find_causes(task, tell)
    tell("looking outside of the library", 0.6)
    selected, outside = against_the_unknown(task, selected, bad, seed)
    more = bad | distrusted_given(selected.best, task.noise.sigma)
    if more.sum() > bad.sum() and len(training) < LONG:
        # A cause that was excluded may have accounted for gross rows.
        selected, bad = find_causes(task, tell, more)
        selected, outside = against_the_unknown(task, selected, bad, seed)
    tell("leaving rows out", 0.7)
    by = kind_of_folds(training, options.held_out)
    selected, outside, evaluation = on_rows_left_out(
        recording, task, selected, outside, bad, by, seed
    )
    tell("weighing the verdict", 0.9)
    noise = noise_of(training, selected.best)
    slipped = slipped_rows(selected.model, selected.best, bad, noise.sigma)
    if len(slipped) and outside.probability < 0.5:
        outside = Outside.slipped(slipped.tolist(), outside.inclusion)
    verdict = judge(recording, selected, evaluation, outside, noise, options.effects, seed)
    verdict = replace(verdict, next=suggestions(selected, verdict, seed))
    tell("done", 1.0)
    return _diagnosis(recording, selected, evaluation, verdict, options)


def _usable(recording: Recording | str | Path, force: bool) -> Recording:
    if not isinstance(recording, Recording):
        recording = load_recording(recording)
    if not force:
        refuse_wrong_set_up(recording)
    return recording


def _task(recording: Recording, options: DiagnosisOptions) -> Task:
    """What is to be searched: the rows that may be fitted, and what is always fitted to them."""
    training = recording if recording.held_out is None else recording.select(~recording.held_out)
    always = always_fitted(training)
    _refuse_more_than_rows_tell(training, always)
    folds = fold_of_rows(training, options.held_out, options.seed)
    noise = NoisePrior.of(training.noise_std)
    return Task(training, folds, noise, always, options.effects, options.solver)


def _lever_unknown(recording: Recording) -> bool:
    stated = recording.noise_std and recording.noise_std_rotation
    return recording.observation == "pose" and not stated


def _diagnosis(
    recording: Recording,
    selected: SelectedModel,
    evaluation: Evaluation,
    verdict: Verdict,
    options: DiagnosisOptions,
) -> Diagnosis:
    return Diagnosis(
        recording=recording,
        verdict=verdict,
        residual_before=evaluation.before,
        residual_after=evaluation.after,
        trusted=evaluation.trusted,
        places=recording.chain.placement(recording.q)[:, :3, 3],
        effects=selected.effects_of_fit,
        solution=selected.best,
        options=options,
        selected=selected,
    )


def _lasts(effect: Effect, other: Recording) -> bool:
    """Whether an effect of one session can be expected, and read, in another one."""
    of_the_session = effect.stage == Stage.BASE and "time" in effect.needs
    scope = scope_of(other)
    known = effect.name not in REGISTRY or bool(REGISTRY[effect.name].candidates(scope))
    return known and not of_the_session and _can_be_read(effect, other)


def _can_be_read(effect: Effect, recording: Recording) -> bool:
    """Whether the recording has what this variant reads; another one may make do with less."""
    try:
        build_model(recording, [effect])
    except KeyError:
        return False
    return True


def _refuse_more_than_rows_tell(recording: Recording, always: Sequence[Effect]) -> None:
    """Refuse to fit always what there are fewer readings for than unknowns.

    Raises:
        PlumblineError: It names the effect that takes the most.
    """
    taken = Counter[str]()
    for effect in always:
        taken[effect.name] += len(effect.parameters)
    unknowns = nuisances_of(recording).size + taken.total()
    a_row = len(recording.measured_joints) or (6 if recording.observation == "pose" else 3)
    readings = len(recording) * a_row
    if taken and unknowns >= readings:
        name, most = taken.most_common(1)[0]
        raise PlumblineError(
            f"{recording.name}: [fit] always takes {unknowns} unknowns, {most} of them for {name}, "
            f"and the rows to fit hold {readings} readings; leave it out, or record more rows"
        )


def always_fitted(recording: Recording) -> tuple[Effect, ...]:
    """Effects that the recording wants in every model, all elements of each."""
    scope = scope_of(recording)
    names = [name for name in recording.always if name in REGISTRY]
    found = [v for name in names for v in REGISTRY[name].candidates(scope)]
    if recording.observation != "joint_position":
        return tuple(found)
    seen = {j + 1 for j in recording.measured_joints}
    return tuple(v for v in found if v.element is None or v.element in seen)

"""A verdict with what it rests on: the recording, the fit, and rows that were left out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import REGISTRY, Effect, Stage
from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import Judgement, judged
from plumbline.optim.core.problem import Array
from plumbline.optim.core.solution import Solution
from plumbline.optim.core.solvers import LevenbergMarquardt, Solver
from plumbline.optim.core.stored import register, restored
from plumbline.optim.diagnosis.findings import Cause, Gap, Place, Verdict
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.search import SelectedModel, fit
from plumbline.optim.diagnosis.posterior.spectrum import as_spectra
from plumbline.optim.diagnosis.predict.held_out import figure, gap_unit, refitted
from plumbline.optim.diagnosis.verdict.words import blame_of
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import Model, build_model, scope_of
from plumbline.optim.measurement.storing import StoredEffect, StoredFit, effect_named
from plumbline.optim.measurement.torque import newton_metres
from plumbline.optim.recording import storing as storing
from plumbline.optim.recording.recording import Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Answer):
    """A verdict with what it rests on.

    Attributes:
        recording: The data.
        verdict: What was found; its fields that are asked for most are this object's as well.
        residual_before: Held-out residuals of the nominal model (N, m) [gap's unit].
        residual_after: Held-out residuals of the verdict's model (N, m) [gap's unit].
        trusted: Rows (N,) that count.
        places: Tip positions in the base frame (N, 3) [m].
        effects: The effects of the verdict.
        stated: The model that was fitted last: the statement that ``solution`` solves.
        solution: The final fit.
        options: How it was asked for.
        search: Where the search ended; None of a diagnosis that was stored.
    """

    recording: Recording
    verdict: Verdict
    residual_before: Array
    residual_after: Array
    trusted: NDArray[np.bool_]
    places: Array
    effects: tuple[Effect, ...]
    stated: Model
    solution: Solution
    options: DiagnosisOptions
    search: SelectedModel | None = None

    def __repr__(self) -> str:
        """The verdict on one line."""
        return f"<Diagnosis of {self.verdict.headline}>"

    @property
    def selected(self) -> SelectedModel:
        """Where the search ended: what the next experiment starts from.

        Raises:
            PlumblineError: The diagnosis was stored, and the search is not.
        """
        if self.search is None:
            raise PlumblineError(
                f"{self.recording.name}: a stored diagnosis holds no search, one expected here; "
                "ask diagnose(answer.recording, answer.options) again"
            )
        return self.search

    @property
    def judged(self) -> Judgement:
        """Whether every fit behind the verdict converged, with the figures."""
        return self.verdict.judged

    @property
    def headline(self) -> str:
        """The recording, the kind of verdict, the first causes and the gap, on one line."""
        return self.verdict.headline

    @property
    def gap(self) -> Gap:
        """How large the gap is and how far it shrinks, on rows that were left out."""
        return self.verdict.gap

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The causes, most important first."""
        return self.verdict.causes

    @property
    def candidates(self) -> tuple[Cause, ...]:
        """Everything considered, most probable first."""
        return self.verdict.candidates

    @property
    def where(self) -> tuple[Place, ...]:
        """Shares of the explained gap by stage and element, which sum to one."""
        return self.verdict.where

    @property
    def outside_probability(self) -> float:
        """Probability that something outside the library is at work."""
        return self.verdict.outside_probability

    @property
    def next(self) -> tuple[dict[str, Any], ...]:
        """What to record next."""
        return self.verdict.next

    @property
    def notes(self) -> tuple[str, ...]:
        """What else the reader should know."""
        return self.verdict.notes

    def card(self) -> str:
        """The verdict's card of HTML."""
        return self.verdict.card()

    def plot(self) -> Figure:
        """The verdict's picture: the gap as the causes go in, one by one."""
        return self.verdict.plot()

    def to_dict(self) -> dict[str, Any]:
        """The verdict's figures as plain data in SI units."""
        return self.verdict.to_dict()

    def transfer(self, other: Recording) -> Transfer:
        """The fitted effects on another recording of the robot, its nuisances alone refitted.

        Left out are effects that belong to the first session (a drift, a bump) and those that need
        a column which the other recording lacks. Ripples of many orders are carried as spectra.
        """
        nuisance, weights = nuisances_of(other), np.ones(len(other))
        _, nominal = fit(other, (), nuisance, weights, LevenbergMarquardt())
        carried = as_spectra(self.recording.training, self.effects, self.solution)
        sizes = [len(e.parameters) for e in carried.effects]
        values = np.split(carried.values, np.cumsum(sizes))
        lasting = [_lasts(e, other) for e in carried.effects]
        effects = [e for e, kept in zip(carried.effects, lasting, strict=True) if kept]
        held = [v for v, kept in zip(values, lasting, strict=False) if kept]
        after, ended = refitted(other, effects, np.concatenate([np.empty(0), *held]))
        unit, per_row = gap_unit(other)
        by = newton_metres(other)
        before = by * figure(nominal.mapped.residuals(nominal.x), per_row)
        went = {(e.name, e.element) for e in effects}
        stays = dict.fromkeys((e.name, e.element) for e in carried.effects)
        left_out = [blame_of(key).label for key in stays if key not in went]
        fits = Judgement.of([judged(nominal, "the fit without causes"), ended])
        return Transfer(before, by * figure(after, per_row), unit, tuple(left_out), fits)


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


@dataclass(frozen=True)
class _Asked:
    """Options, the library by its effects' names."""

    held_out: str
    seed: int
    without: tuple[str, ...]
    library: tuple[str, ...]
    solver: Solver
    force: bool

    @classmethod
    def of(cls, o: DiagnosisOptions) -> _Asked:
        names = tuple(effect.name for effect in o.library)
        return cls(o.held_out, o.seed, tuple(o.without), names, o.solver, o.force)

    @property
    def options(self) -> DiagnosisOptions:
        library = tuple(effect_named(name) for name in self.library)
        return DiagnosisOptions(
            self.held_out, self.seed, self.without, library, self.solver, self.force
        )


@dataclass(frozen=True, eq=False)
class _Stored:
    """What is stored of a diagnosis; the search is not."""

    recording: Recording
    verdict: Verdict
    residual_before: Array
    residual_after: Array
    trusted: NDArray[np.bool_]
    places: Array
    effects: tuple[StoredEffect, ...]
    fit: StoredFit
    asked: _Asked

    @classmethod
    def of(cls, d: Diagnosis) -> _Stored:
        return cls(
            d.recording,
            d.verdict,
            d.residual_before,
            d.residual_after,
            d.trusted,
            d.places,
            tuple(StoredEffect.of(effect) for effect in d.effects),
            StoredFit.of(d.stated, d.solution),
            _Asked.of(d.options),
        )

    @classmethod
    def again(cls, data: Any) -> Diagnosis:
        s = restored(data, cls)
        effects = tuple(one.effect for one in s.effects)
        stated, solution = s.fit.again(s.recording.training, effects)
        return Diagnosis(
            s.recording,
            s.verdict,
            s.residual_before,
            s.residual_after,
            s.trusted,
            s.places,
            effects,
            stated,
            solution,
            s.asked.options,
        )


register(Diagnosis, _Stored.of, _Stored.again)

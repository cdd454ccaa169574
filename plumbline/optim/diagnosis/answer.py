"""A verdict with what it rests on: the recording, the fit, and rows that were left out."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import Effect
from plumbline.optim.core.answer import parts_of, register, restored, restored_parts
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array, Flags
from plumbline.optim.diagnosis.findings import Estimate, Verdict
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.posterior.spectrum import Carried, as_spectra
from plumbline.optim.diagnosis.prior import ROUNDING
from plumbline.optim.diagnosis.verdict.parts import nuisances_of_parts
from plumbline.optim.diagnosis.with_verdict import Told, WithVerdict
from plumbline.optim.measurement.observation import MeasurementModel
from plumbline.optim.measurement.storing import StoredFit
from plumbline.optim.model import Applied, apply
from plumbline.optim.model import Model as FoundModel
from plumbline.optim.model.fitted import HeldOutGap
from plumbline.optim.model.making import FitEnd, beam_model, model_of, number_of, of_part
from plumbline.optim.recording import storing as storing
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(WithVerdict):
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
    trusted: Flags
    places: Array
    effects: tuple[Effect, ...]
    stated: MeasurementModel
    solution: Solution
    options: DiagnosisOptions
    search: SelectedModel | None = None

    #: frame, tool, sockets and what else was always fitted, by name
    nuisances = Told[dict[str, Estimate]]()
    frame = Told[dict[str, Estimate]]()  #: the robot's base in the device's frame
    tool = Told[dict[str, Estimate]]()  #: the tool's tip in the tip frame
    sockets = Told[dict[str, Estimate]]()  #: places of the sockets in the robot's base frame
    zeros = Told[dict[str, Estimate]]()  #: zeros of encoders, where they are always fitted

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

    def model(self, recording: str = "") -> FoundModel:
        """What was found, to take home: where the tip is, what to command, files for others.

        Ripples of many orders are carried as spectra. Of fiducials it takes places of CT, three
        joints [m], to where the robot finds them (``in_device``), markers that moved left out.

        Args:
            recording: Of several recordings the one whose frame and tool it has; the first that
                says where the tip is, if not given.

        Raises:
            PlumblineError: There is no recording of that name, or the rows are ranges from poses.
        """
        if self.recording.stand_in and not self.recording.kind.fiducials:
            raise PlumblineError(
                f"{self.recording.name}: {self.recording.observation} from poses, of which there "
                "is no model, an arm's joints q1, q2, ... expected; record them beside the poses"
            )
        session = self.recording.session
        if session is None:
            return self._model
        k = number_of(session, recording)
        return model_of(session.parts[k], of_part(self._carried, k), _held(self.verdict))

    @cached_property
    def _model(self) -> FoundModel:
        found = model_of(self.recording.training, self._carried, _held(self.verdict))
        return beam_model(found) if self.recording.kind.ranges else found

    @cached_property
    def _carried(self) -> FitEnd:
        rows = self.recording.training
        given = (rows, self.effects, self.solution)
        return _fit_of(self, as_spectra(*given, self.options.effects))

    def transfer(self, other: Recording, *, force: bool = False) -> Applied:
        """The causes held on another recording of the robot, what is always fitted fitted again.

        Left out are effects that belong to the first session (a drift, a bump) and those that need
        a column which the other recording lacks.

        Raises:
            PlumblineError: It is of another robot, or measures something else, or, without force,
                another simple set-up explains its rows far better.
        """
        session = self.recording.session
        alike = (
            [p.name for p in session.parts if p.observation == other.observation] if session else []
        )
        return apply(self.model(*alike[:1]), other, force=force)


def nuisances_found(diagnosis: Diagnosis) -> dict[str, Estimate]:
    """Frame, tool, sockets and what else was always fitted, as the final fit has them."""
    as_fitted = _fit_of(diagnosis, Carried(diagnosis.effects, np.empty(0)))
    if diagnosis.recording.element is not None:
        return nuisances_of_parts(diagnosis.recording.observation, as_fitted)
    session, held = diagnosis.recording.session, _held(diagnosis.verdict)
    if session is None:
        return _estimates(model_of(diagnosis.recording.training, as_fitted, held))
    return {
        f"{name} of {part.name}": estimate
        for k, part in enumerate(session.parts)
        for name, estimate in _estimates(model_of(part, of_part(as_fitted, k), held)).items()
    }


def _estimates(model: FoundModel) -> dict[str, Estimate]:
    found = model.nuisances.items()
    return {n: Estimate(k.value, k.std, k.unit, doc=k.doc) for n, k in found}


def _fit_of(diagnosis: Diagnosis, carried: Carried) -> FitEnd:
    """Where the fit ended, the ripples as spectra where they are carried so."""
    if carried.whole is not None:
        model, x, precision = carried.whole
        return FitEnd(model.nuisance, carried.effects, x, model.problem.scale, precision)
    noise, best = diagnosis.verdict.noise, diagnosis.solution
    sigma = noise.sigma * max(noise.ratio, 1.0)
    if diagnosis.recording.kind.efforts:  # residuals are weighed, joint by joint
        sigma = float(np.sqrt(best.gram.square / best.gram.count))
    sigma = max(sigma, ROUNDING)
    precision = best.gram.matrix / sigma**2
    nuisance = diagnosis.stated.nuisance
    return FitEnd(nuisance, diagnosis.effects, best.x, best.problem.scale, precision)


def _held(verdict: Verdict) -> HeldOutGap:
    gap = verdict.gap
    floor = gap.noise_floor if verdict.knows_noise else np.nan
    sigma = verdict.noise.sigma * max(verdict.noise.ratio, 1.0)
    return HeldOutGap(gap.before, gap.after, floor, gap.unit, sigma)


def _taken(d: Diagnosis) -> dict[str, Any]:
    """What is stored of a diagnosis; the search is not."""
    own = parts_of(d, "stated", "solution", "options", "search")
    return own | {"fit": StoredFit.of(d.stated, d.solution), "asked": d.options}


def _again(data: Any) -> Diagnosis:
    given = restored_parts(data, Diagnosis)
    fit, asked = restored(data["fit"], StoredFit), restored(data["asked"], DiagnosisOptions)
    stated, solution = fit.again(given["recording"].training, given["effects"])
    return Diagnosis(**given, stated=stated, solution=solution, options=asked)


register(Diagnosis, _taken, _again)

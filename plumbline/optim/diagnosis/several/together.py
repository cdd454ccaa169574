"""Several recordings of one robot, one verdict: each searched alone, then all of them at once.

What each recording's own search names is asked again of all: as a cause that all of them share,
and as one that is at work in that recording only. Residuals are in units of each one's noise.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.confined import confined
from plumbline.optim.core.progress import Progress, silent
from plumbline.optim.core.quantities import quantity
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.constants import LEAST_NOISE, OWN_SHARE
from plumbline.optim.diagnosis.diagnose import diagnose, task_of, usable
from plumbline.optim.diagnosis.findings import NoiseLevel
from plumbline.optim.diagnosis.of_recordings import OfRecording
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.noise import noise_of
from plumbline.optim.diagnosis.posterior.robust import noise_lever
from plumbline.optim.diagnosis.posterior.search import SelectedModel, Task, find_causes
from plumbline.optim.diagnosis.prior import FAR, LEAST_NAMED
from plumbline.optim.diagnosis.several.transfer import Each, figures, transfers
from plumbline.optim.measurement.candidates import runs_once
from plumbline.optim.measurement.constants import UNIT
from plumbline.optim.measurement.refit import gap_unit
from plumbline.optim.measurement.torque import newton_metres
from plumbline.optim.recording.recording import Recording, Session
from plumbline.optim.recording.session import apart, joined


@dataclass(frozen=True)
class _Alone:
    """What one recording says on its own: its noise, and what may be at work in it."""

    recording: Recording
    sigma: float
    source: str
    weighing: float  # its noise as its own fit has settled it, by which its rows are weighed
    effects: tuple[Effect, ...]


def diagnose_session(
    session: Session,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Diagnosis:
    """One verdict on several recordings of a robot.

    Args:
        session: The recordings. Of one alone the verdict is that recording's.
        options: How; see :class:`~plumbline.optim.diagnosis.options.DiagnosisOptions`.
        progress: Called with what is being done and the share done.

    Raises:
        PlumblineError: One of them cannot be used, see
            :func:`plumbline.optim.diagnosis.diagnose.diagnose`.
    """
    options = options or DiagnosisOptions()
    tell = progress or silent
    if len(session) == 1:
        return diagnose(session.parts[0], options, progress=progress)
    alone = []
    for k, part in enumerate(session.parts):
        tell(f"searching {part.name} alone", OWN_SHARE * k / len(session))
        alone.append(_alone(part, options))
    suspects = _suspects(alone)
    session = replace(session, parts=tuple(a.recording for a in alone), suspects=suspects)
    efforts = session.parts[0].kind.efforts
    joint = joined(session, [a.sigma / UNIT if efforts else a.weighing for a in alone])
    found = diagnose(
        joint, options, progress=lambda words, share: tell(words, OWN_SHARE + 0.6 * share)
    )
    noises = [(a.sigma * newton_metres(a.recording), a.source) for a in alone]
    return _with_each(found, session, noises)


def _alone(part: Recording, options: DiagnosisOptions) -> _Alone:
    """A recording on its own: its noise, and what its own search would name."""
    part = usable(part, options.force)
    task = task_of(part, options)
    selected, _ = find_causes(task, silent)
    if part.kind.oriented and not (part.noise_std and part.noise_std_rotation):
        part = replace(part, lever=noise_lever(selected.best, task.recording))
    noise = noise_of(task.recording, selected.best)
    return _Alone(
        part, noise.sigma, noise.source, _settled(noise, task, selected), selected.effects
    )


def _settled(noise: NoiseLevel, task: Task, selected: SelectedModel) -> float:
    """The noise that a fit of these rows leaves, which what is stated of it counts towards."""
    count = max(selected.best.gram.count - selected.best.problem.size, 1.0)
    left = (noise.ratio * noise.sigma) ** 2 * count
    return float(np.sqrt(task.noise.variance(left, count)))


def _suspects(alone: Sequence[_Alone]) -> tuple[Effect, ...]:
    """What each search has named, confined to its own recording; moments are so anyway."""
    return tuple(
        confined(effect, (k,), f"in {one.recording.name}")
        for k, one in enumerate(alone)
        for effect in one.effects
        if not runs_once(effect)
    )


def _with_each(found: Diagnosis, session: Session, noises: list[tuple[float, str]]) -> Diagnosis:
    """The diagnosis with what it means for each recording."""
    each = Each(found.selected, session, apart(found.recording.training)[1])
    listed = figures(each, found, noises)
    said = [line for one, part in zip(listed, session.parts, strict=True)
            if (line := beyond_its_noise(one, part))]  # fmt: skip
    verdict = replace(
        found.verdict,
        recordings=listed,
        transfer=transfers(each),
        notes=(*said, *found.verdict.notes),
    )
    if said and verdict.outside_probability > LEAST_NAMED:  # what is left is left there
        verdict = replace(verdict, outside_depends_on=said[0])
    return replace(found, verdict=verdict)


def beyond_its_noise(one: OfRecording, part: Recording) -> str:
    """A line on a recording that is missed by far more than the noise that it states, or nothing.

    The noise is of one axis, a gap of places of three.
    """
    axes = math.sqrt(3.0) if gap_unit(part)[1] else 1.0
    ratio = one.after / max(one.noise * axes, LEAST_NOISE)
    if one.noise_source != "given" or ratio <= FAR:
        return ""
    return (
        f"{one.name} is missed by {ratio:.2g} times the noise that it states "
        f"({quantity(one.noise, one.unit)}): look at its noise_std, then for what it alone has"
    )

r"""Several motions of one robot, one verdict: each joint's drive fitted to the windows of all.

Nothing is any motion's own: commands, clock and joints say what there is. Of each cause one motion
alone is held against all others,

.. math:: z = \frac{|\hat a_k - \hat a_o|}{\sqrt{\sigma_k^2 + \sigma_o^2}}

with standard errors that know of what nobody has listed.

Several recordings of one robot, one verdict: each searched alone, then all of them at once.

What each recording's own search names is asked again of all: as a cause that all of them share,
and as one that is at work in that recording only. Residuals are in units of each one's noise, as
its own fit has it, then as that of all does.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plumbline.errors import fault, one_line
from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.confined import confined
from plumbline.kinematics.robot import joints_named
from plumbline.optim.core.progress import Progress, silent
from plumbline.optim.core.quantities import quantity
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.constants import OWN_SHARE
from plumbline.optim.diagnosis.diagnose import diagnose, task_of, usable
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.constants import MOST_JUDGED
from plumbline.optim.diagnosis.motion.diagnose import diagnose_motion
from plumbline.optim.diagnosis.motion.fit import evaluated, fitted
from plumbline.optim.diagnosis.motion.models import Models
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.search import JointFindings, errors_of, prior_at
from plumbline.optim.diagnosis.motion.signals import Integers, Signals, spread
from plumbline.optim.diagnosis.motion.windows import Windows
from plumbline.optim.diagnosis.of_recordings import AgainstOthers, Carries, OfRecording, Transfer
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.noise import noise_of, scatter_of
from plumbline.optim.diagnosis.posterior.robust import noise_lever
from plumbline.optim.diagnosis.posterior.search import find_causes
from plumbline.optim.diagnosis.prior import FAR, LEAST_NAMED, ROUNDING, SETTLED_WITHIN
from plumbline.optim.diagnosis.several.transfer import Each, figures, masses_carry, transfers
from plumbline.optim.measurement.constants import UNIT
from plumbline.optim.measurement.refit import gap_unit, runs_once
from plumbline.optim.measurement.torque import newton_metres, stated_noise
from plumbline.optim.model.constants import CHANGED
from plumbline.optim.recording.recording import Recording, Session, hash_of
from plumbline.optim.recording.session import (
    Rows,
    apart,
    joined,
    named_apart,
    refuse_copies,
    rows_of,
    same_joints,
)
from plumbline.optim.recording.table import Flags


def diagnose_motions(
    motions: Sequence[MotionRecording],
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> MotionDiagnosis:
    """One verdict on several motions of a robot.

    Args:
        motions: At least one.
        options: As of :func:`~plumbline.optim.diagnosis.motion.diagnose.diagnose_motion`.
        progress: Called with what is being done and the share done.

    Raises:
        PlumblineError: They are of different drives, or one cannot be used.
    """
    if len(motions) == 1:
        return diagnose_motion(motions[0], options, progress=progress)
    names = named_apart([m.name for m in motions])
    motions = [replace(m, name=name) for m, name in zip(motions, names, strict=True)]
    found = diagnose_motion(joined_motions(motions), options, progress=progress)
    # Which motion each window starts in (W,)
    groups = [1 if m.group is None else len(np.unique(m.group)) for m in motions]
    owner = np.repeat(np.arange(len(motions)), groups)
    part = np.asarray(owner[found.signals.group[found.signals.starts]], dtype=np.int64)
    verdict = replace(
        found.verdict,
        recordings=tuple(_figures(found, part, k, motion) for k, motion in enumerate(motions)),
        transfer=tuple(
            line
            for k, motion in enumerate(motions)
            for line in masses_carry(found.signals, found.joints, part == k, motion.name)
        )
        + tuple(
            line
            for joint in found.joints
            for k, motion in enumerate(motions)
            for line in _transfers(found, joint, part == k, motion.name)
        ),
    )
    return replace(found, verdict=verdict)


def joined_motions(motions: Sequence[MotionRecording]) -> MotionRecording:
    """All of them as one recording, each a group, or several, of its own.

    Raises:
        PlumblineError: They are of different drives, or one is another's copy.
    """
    first = motions[0]
    before: list[tuple[str, Rows]] = []
    for other in motions:
        _refuse_other(first, other)
        rows = rows_of(other.command, other.q)
        refuse_copies(before, other.name, rows)
        before.append((other.name, rows))
    own = [np.zeros(len(m), np.int64) if m.group is None else m.group for m in motions]
    pairs = np.vstack([np.column_stack([np.full(len(g), k), g]) for k, g in enumerate(own)])
    group = np.unique(pairs, axis=0, return_inverse=True)[1].ravel()
    held = [np.zeros(len(m), bool) if m.held_out is None else m.held_out for m in motions]
    stated = [m.noise_std for m in motions if m.noise_std is not None]
    known = len(stated) == len(motions)
    return replace(
        first,
        name=" + ".join(m.name for m in motions),
        time=np.concatenate([m.time for m in motions]),
        command=np.concatenate([m.command for m in motions]),
        q=np.concatenate([m.q for m in motions]),
        group=group.astype(np.int64),
        held_out=np.concatenate(held) if any(h.any() for h in held) else None,
        noise_std=float(np.sqrt(np.mean(np.square(stated)))) if known else None,
        sha256=hash_of(*(m.sha256.encode() for m in motions)),
        notes=tuple(one_line(f"{m.name}: {note}") for m in motions for note in m.notes),
    )


def _refuse_other(first: MotionRecording, other: MotionRecording) -> None:
    mend = "give motions of the same drives, commanded alike"
    for what, one, two in (
        ("commands", first.law, other.law), ("joints", len(first.joints), len(other.joints)),
        ("observation", first.observation, other.observation),
        ("kp", first.kp, other.kp), ("kd", first.kd, other.kd),
    ):  # fmt: skip
        if not (np.allclose(one, two, rtol=1e-6) if what[0] == "k" else one == two):
            raise fault(f"{other.name}, {what}", str(two), f"{one} as in {first.name}", mend)
    moved = (joints_named(m.robot, m.joints) for m in (first, other))
    if not same_joints(*moved):
        found = f"{other.robot.name} with joints placed or turning otherwise"
        raise fault(f"{other.name}, robot", found, f"{first.robot.name} as in {first.name}", mend)


def _figures(
    found: MotionDiagnosis, part: Integers, k: int, motion: MotionRecording
) -> OfRecording:
    """A motion's own figures, on windows that were left out."""
    signals, level = found.signals, found.verdict.noise
    starts = signals.starts[part == k]
    squares = []
    for joint, judged in zip(found.joints, found.left_out, strict=True):
        mine = np.isin(judged.starts, starts)
        less = _without_it(signals, joint, part == k)
        squares.append([judged.before[mine].mean(), judged.after[mine].mean(), less])
    before, after, without = np.sqrt(np.mean(squares, axis=0)).tolist()
    return OfRecording(
        name=motion.name, observation=motion.observation, rows=len(motion), unit=motion.unit,
        before=before, after=after, without_it=without,
        noise=motion.noise_std or level.sigma,
        noise_source="given" if motion.noise_std else level.source,
    )  # fmt: skip


def _without_it(signals: Signals, joint: JointFindings, mine: Flags) -> float:
    """Mean square of a motion's windows with causes fitted to the others alone [rad^2]."""
    others = _windows(signals, joint, ~mine)
    fit = fitted(others, joint.fit.effects, joint.fit.theta)
    return evaluated(_windows(signals, joint, mine), fit.effects, fit.theta).square


def _windows(signals: Signals, joint: JointFindings, chosen: Flags) -> Windows:
    starts = signals.starts[chosen]
    return signals.windows(joint.number - 1, spread(starts, MOST_JUDGED))


def _transfers(
    found: MotionDiagnosis, joint: JointFindings, mine: Flags, name: str
) -> list[Transfer]:
    """Every cause of a joint's drive as one motion alone says it, and what all others say."""
    if not joint.fit.effects:
        return []
    prior = prior_at(found.options.unlisted, len(found.joints))
    parts = [_windows(found.signals, joint, chosen) for chosen in (mine, ~mine)]
    sides = [fitted(part, joint.fit.effects, joint.fit.theta) for part in parts]
    seen, sigma = found.signals.seen(joint.number - 1), found.signals.sigma
    errors = [
        errors_of(Models(part, fit.effects, seen), fit, prior, sigma)
        for part, fit in zip(parts, sides, strict=True)
    ]
    law, scales, lines = found.recording.law, joint.fit.scales, []
    for p, effect in enumerate(joint.fit.effects):
        (one, other), (std, others_std) = (fit.theta[p] for fit in sides), (e[p] for e in errors)
        z = float(abs(one - other) / np.hypot(std, others_std))
        told = max(std, others_std) < scales[p]
        carries = Carries.NO if z > CHANGED else Carries.YES if told else Carries.UNTOLD
        said = AgainstOthers(
            float(one), float(std), float(other), float(others_std), effect.unit(law)
        )
        values = {effect.parameter.name: said}
        lines.append(Transfer(effect.name, joint.number, name, carries, z, values))
    return lines


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
    # What each search has named, confined to its own recording; moments are so anyway.
    suspects = tuple(
        confined(effect, (k,), f"in {one.recording.name}")
        for k, one in enumerate(alone)
        for effect in one.effects
        if not runs_once(effect)
    )
    session = replace(session, parts=tuple(a.recording for a in alone), suspects=suspects)
    efforts = session.parts[0].kind.efforts
    weighing = [a.sigma / UNIT if efforts else a.weighing for a in alone]

    def together(noises: Sequence[float]) -> Diagnosis:
        return diagnose(
            joined(session, noises), options,
            progress=lambda words, share: tell(words, OWN_SHARE + 0.6 * share),
        )  # fmt: skip

    found = together(weighing)
    noises = [(a.sigma * newton_metres(a.recording), a.source) for a in alone]
    if not efforts:
        settled = _noises_together(found, session)
        if not _weigh_alike(settled, weighing):
            found = together(settled)
            settled = _noises_together(found, session)
        given = zip(noises, settled, strict=True)
        noises = [(new if by == "fit" else old, by) for (old, by), new in given]
    return _with_each(found, session, noises)


def _noises_together(found: Diagnosis, session: Session) -> list[float]:
    """The noise of each recording as the fit of all has it, towards what is stated of it [unit].

    Of few rows a fit of their own finds less, and takes what it has not found for noise.
    """
    each, noises = Each(found.selected, session, apart(found.recording.training)[1]), []
    shape = found.recording.training.noise_shape
    for k, part in enumerate(session.parts):
        over = 1.0 if shape is None else np.mean(shape[each.part == k][:, session.live(k)])
        own = 1.0 if part.noise_shape is None else float(np.mean(part.noise_shape))
        sigma = float(over / own) * scatter_of(found.selected.best, each.grams[k])
        count = max(each.grams[k].count, 1.0)
        stated = NoisePrior.of(stated_noise(part))
        noises.append(float(np.sqrt(stated.variance(sigma**2 * count, count))))
    return noises


def _weigh_alike(noises: Sequence[float], before: Sequence[float]) -> bool:
    """Whether rows of such noises count for as much beside each other as before."""
    now, was = (np.square(n) / np.mean(np.square(n)) for n in (noises, before))
    return bool((np.abs(now - was) <= SETTLED_WITHIN * (now + was)).all())


def _alone(part: Recording, options: DiagnosisOptions) -> _Alone:
    """A recording on its own: its noise, and what its own search would name."""
    part = usable(part, options.force)
    task = task_of(part, options)
    selected, _ = find_causes(task, silent)
    if part.kind.oriented and not (part.noise_std and part.noise_std_rotation):
        part = replace(part, lever=noise_lever(selected.best, task.recording))
    noise = noise_of(task.recording, selected.best)
    # What is stated of it counts towards the noise that a fit of these rows leaves.
    count = max(selected.best.gram.count - selected.best.problem.size, 1.0)
    weighing = task.noise.variance((noise.ratio * noise.sigma) ** 2 * count, count) ** 0.5
    return _Alone(part, noise.sigma, noise.source, float(weighing), selected.effects)


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
    ratio = one.after / max(one.noise * axes, ROUNDING)
    if one.noise_source != "given" or ratio <= FAR:
        return ""
    return (
        f"{one.name} is missed by {ratio:.2g} times the noise that it states "
        f"({quantity(one.noise, one.unit)}): look at its noise_std, then for what it alone has"
    )

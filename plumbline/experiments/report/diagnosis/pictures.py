"""Every picture of a report, with the finding it shows as its title and a sentence or two."""

from collections.abc import Callable

import numpy as np

from plumbline.experiments.report.diagnosis import causes, figures, parts, torques
from plumbline.experiments.report.diagnosis.arm import arm
from plumbline.experiments.report.diagnosis.subject import Subject, running
from plumbline.experiments.report.page.page import Picture
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import counted, percent, significant
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.verdict.words import held_words, noise_words, place_words


def pictures(subject: Subject) -> tuple[Picture, ...]:
    """All pictures that the recording allows, in the order of the report."""
    found = [make(subject) for make in MAKERS]
    return tuple(picture for picture in found if picture is not None)


def of_diagnosis(diagnosis: Diagnosis) -> dict[str, Picture]:
    """The same of a diagnosis, by their keys."""
    return {picture.key: picture for picture in pictures(Subject.of(diagnosis))}


def _where(subject: Subject) -> Picture | None:
    where, stages = subject.verdict.where, subject.recording.stand_in
    if not where:
        return None
    first = place_words(where[0].stage, where[0].element)
    whole = where[0].element is not None or first.startswith("all ")
    first = first if whole else f"the {first}"
    of = "explained gap comes from" if subject.verdict.causes else "gap points to"
    drawn = [causes.shares(subject.verdict)]
    drawn = drawn if stages else [arm(subject), *drawn]
    name = "diagnosis.where" + "_of_stages" * stages
    return Picture.of(name, *drawn, share=percent(where[0].share), of=of, first=first)


def _ripples(subject: Subject) -> Picture | None:
    found = causes.with_curves(subject.verdict)
    return Picture.of("diagnosis.ripples", causes.curves(found)) if found else None


def _staircase(subject: Subject) -> Picture | None:
    verdict = subject.verdict
    if not verdict.staircase:
        return None
    last = "The last bar is the gap's own; those of fewer causes are in proportion to it. "
    known = verdict.knows_noise
    return Picture.of(
        "diagnosis.staircase",
        causes.staircase(verdict),
        held=held_words(verdict),
        ratio=significant(verdict.gap.after / max(verdict.gap.noise_floor, 1e-300), 2),
        left="the noise" if known else "what the fit of all rows leaves",
        last=last if verdict.causes else "",
        line="the instrument's noise alone would give" if known else "the fit of all rows leaves",
    )


def _ranking(subject: Subject) -> Picture | None:
    verdict = subject.verdict
    if not causes.ranked(verdict):
        return None
    considered = max(len(verdict.candidates), len(verdict.causes))
    less = considered - len(causes.ranked(verdict))
    return Picture.of(
        "diagnosis.ranking",
        causes.ranking(verdict),
        considered=counted(considered, "candidate"),
        named=counted(len(verdict.causes), "cause") if verdict.causes else "no cause",
        hidden=f"; {less} less probable ones are not drawn" if less > 0 else "",
    )


def _workspace(subject: Subject) -> Picture | None:
    if subject.encoders or subject.recording.element is not None:
        return None
    before, after = (float(np.nanpercentile(s, 95.0)) for s in subject.sizes)
    drawn, unit = figures.workspace(subject), subject.unit
    was = f", where it was {significant(before)} {unit}" if after != before else ""
    return Picture.of("diagnosis.workspace", *drawn, after=significant(after), unit=unit, was=was)


def _beam(subject: Subject) -> Picture | None:
    return Picture.of("diagnosis.beam", *parts.over_the_beam(subject)) if subject.ranges else None


def _planes(subject: Subject) -> Picture | None:
    return Picture.of("diagnosis.planes", *parts.over_planes(subject)) if subject.ranges else None


def _markers(subject: Subject) -> Picture | None:
    if not subject.touches:
        return None
    (first, before), (_, after) = (_worst_marker(subject, sizes) for sizes in subject.sizes)
    told = {"first": first, "before": significant(before), "after": significant(after)}
    drawn = parts.by_marker(subject)
    return Picture.of("diagnosis.markers", *drawn, unit=subject.unit, **told)


def _worst_marker(subject: Subject, sizes: Array) -> tuple[int, float]:
    """The marker of largest root mean square distance, and that."""
    part = subject.recording.element
    assert part is not None
    each = {int(k): float(np.sqrt(np.mean(sizes[part == k] ** 2))) for k in np.unique(part)}
    worst = max(each, key=lambda k: each[k])
    return worst, each[worst]


def _joints(subject: Subject) -> Picture | None:
    if subject.recording.stand_in:
        return None
    if subject.encoders:
        what = (
            "The residual of each joint's effort" if subject.torques else "Each encoder's residual"
        )
        title, line = _joint_told(subject), "means"
    else:
        title, what, line = _flatter(subject), "Size of the residual", "medians"
    drawn = figures.over_joints(subject)
    return Picture.of("diagnosis.joints", *drawn, title=title, what=what, line=line)


def _flatter(subject: Subject) -> str:
    """The joint whose reading the residual depended on most, by the swing of running medians."""
    waves = []
    for joint in range(subject.recording.chain.n):
        q = subject.recording.q[:, joint]
        medians = [running(q, sizes)[1] for sizes in subject.sizes]
        waves.append([float(np.ptp(m)) if len(m) else 0.0 for m in medians])
    worst = int(np.argmax([before for before, _ in waves]))
    before, after = waves[worst]
    if before <= 0.0:
        return "Residuals over each joint"
    said = f"Over joint {worst + 1}'s travel the median swings by {significant(before)}"
    if after == before:
        return f"{said} {subject.unit}"
    return f"{said} {subject.unit} before, by {significant(after)} {subject.unit} after"


def _joint_told(subject: Subject) -> str:
    """The joint whose own residual shrinks most; where none does, the one that is off most."""
    sizes = {
        joint: [float(np.sqrt(np.nanmean(r[:, k] ** 2))) for r in (subject.before, subject.after)]
        for joint, k in subject.encoder_columns.items()
    }
    told = max(sizes, key=lambda j: (sizes[j][0] / max(sizes[j][1], 1e-300), sizes[j][0]))
    before, after = sizes[told]
    does = "gains" if after < before else "disagrees"
    return (
        f"Joint {told + 1} {does} most: {significant(before)} {subject.unit} root mean square "
        f"before, {significant(after)} {subject.unit} after"
    )


def _velocity(subject: Subject) -> Picture | None:
    drawn = figures.over_velocity(subject)
    name = "diagnosis.velocity" + "_of_efforts" * subject.torques
    return Picture.of(name, *drawn) if drawn else None


def _friction(subject: Subject) -> Picture | None:
    drawn = torques.friction(subject)
    joints = counted(len(drawn), "joint")
    return Picture.of("diagnosis.friction", *drawn, joints=joints) if drawn else None


def _torques(subject: Subject) -> Picture | None:
    drawn = torques.torques(subject) if subject.torques else ()
    return Picture.of("diagnosis.torques", *drawn) if drawn else None


def _time(subject: Subject) -> Picture | None:
    drawn = figures.over_time(subject)
    if not drawn or subject.recording.time is None:
        return None
    median = running(subject.recording.time, subject.sizes[1])[1]
    title = "Residuals over time"
    if len(median):
        title = (
            f"In time, the running median after the causes stays between "
            f"{significant(float(median.min()))} and {significant(float(median.max()))} "
            f"{subject.unit}"
        )
    return Picture.of("diagnosis.time", *drawn, title=title)


def _noise(subject: Subject) -> Picture | None:
    noise, unit = subject.verdict.noise, subject.verdict.gap.unit
    title = "Residuals against the noise"
    if np.isfinite(noise.ratio) and subject.verdict.knows_noise:
        left = "what is left" if subject.verdict.verdict != Outcome.NO_GAP else "the residual"
        title = f"Fitted to all rows, {left} is {significant(noise.ratio)} times the noise"
    known = np.isfinite(noise.sigma)
    line = f" The line is the noise: {noise_words(noise, unit)}." if known else ""
    return Picture.of("diagnosis.noise", figures.against_noise(subject), title=title, line=line)


MAKERS: tuple[Callable[[Subject], Picture | None], ...] = (
    _where, _staircase, _ranking, _ripples, _workspace, _beam, _planes, _markers, _joints,
    _velocity, _friction, _torques, _time, _noise,
)  # fmt: skip

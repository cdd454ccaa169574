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
    where = subject.verdict.where
    if not where:
        return None
    first = place_words(where[0].stage, where[0].element)
    first = first if where[0].element is not None else f"the {first}"
    of = "explained gap comes from" if subject.verdict.causes else "gap points to"
    title = f"{percent(where[0].share)} of the {of} {first}"
    if subject.recording.stand_in:
        return Picture(
            "where",
            title,
            "Shares of what the causes explain, by the place where they sit; they sum to one.",
            (causes.shares(subject.verdict),),
        )
    return Picture(
        "where",
        title,
        "The arm in a typical recorded posture, joints numbered from the base. The more of the gap "
        "a part accounts for, the deeper its orange; grey parts are innocent as far as is known. "
        "What is not part of the arm is in the bars alone.",
        (arm(subject), causes.shares(subject.verdict)),
    )


def _ripples(subject: Subject) -> Picture | None:
    found = causes.with_curves(subject.verdict)
    if not found:
        return None
    return Picture(
        "ripples",
        "Ripples of joints over their own angle",
        "All orders of a ripple together, over the range that was recorded, with a band of two "
        "standard errors on either side.",
        (causes.curves(found),),
    )


def _staircase(subject: Subject) -> Picture | None:
    verdict = subject.verdict
    if not verdict.staircase:
        return None
    ratio = verdict.gap.after / max(verdict.gap.noise_floor, 1e-300)
    count = len(verdict.causes)
    held = "The last bar is the gap's own; those of fewer causes are in proportion to it. "
    known = verdict.knows_noise
    left = "the noise" if known else "what the fit of all rows leaves"
    line = "the instrument's noise alone would give" if known else "the fit of all rows leaves"
    return Picture(
        "staircase",
        f"With {held_words(verdict)} in the model, {significant(ratio, 2)} times {left} is left",
        "What is left on rows that the fit has not seen, as the causes go into the model one after "
        f"the other. {held if count else ''}The dashed line is what {line}.",
        (causes.staircase(verdict),),
        wide=True,
    )


def _ranking(subject: Subject) -> Picture | None:
    verdict = subject.verdict
    if not causes.ranked(verdict):
        return None
    considered = max(len(verdict.candidates), len(verdict.causes))
    named = counted(len(verdict.causes), "cause") if verdict.causes else "no cause"
    less = considered - len(causes.ranked(verdict))
    hidden = f"; {less} less probable ones are not drawn" if less > 0 else ""
    return Picture(
        "ranking",
        f"{counted(considered, 'candidate')} considered, {named} found",
        "How probable it is that each effect is at work, given all else in the verdict. "
        f"Blue ones are in the verdict, grey ones are not{hidden}.",
        (causes.ranking(verdict),),
        wide=True,
    )


def _workspace(subject: Subject) -> Picture | None:
    if subject.encoders or subject.recording.element is not None:
        return None
    before, after = (float(np.nanpercentile(s, 95.0)) for s in subject.sizes)
    return Picture(
        "workspace",
        f"95 % of the tips lie within {significant(after)} {subject.unit} of their prediction"
        + (f", where it was {significant(before)} {subject.unit}" if after != before else ""),
        "Every dot is a row, where the tip was; its colour is the distance between the predicted "
        "and the measured tip, on one scale for all panels. Structure that remains below is "
        "structure that no named cause explains.",
        figures.workspace(subject),
        last_wide=True,
    )


def _beam(subject: Subject) -> Picture | None:
    if not subject.ranges:
        return None
    return Picture(
        "beam",
        "Residuals over the angle and the length of the beam",
        "Predicted less measured range, grey before, blue with the causes in the model. A line "
        "that bends over the angle tells of slanted beams, one that climbs over the range of the "
        "finder's scale.",
        parts.over_the_beam(subject),
    )


def _planes(subject: Subject) -> Picture | None:
    if not subject.ranges:
        return None
    return Picture(
        "planes",
        "Where on each plane the ranges are missed",
        "Every dot is where a beam met the plane; red where the prediction is longer than the "
        "reading, so that the plane stands out, blue where it is shorter.",
        parts.over_planes(subject),
        last_wide=True,
    )


def _markers(subject: Subject) -> Picture | None:
    if not subject.touches:
        return None
    before, after = (_worst_marker(subject, sizes) for sizes in subject.sizes)
    return Picture(
        "markers",
        f"The worst marker is missed by {significant(before[1])} {subject.unit} before (marker "
        f"{before[0]}), by {significant(after[1])} {subject.unit} after",
        "Every dot is a touch: how far it lies from where CT and the rigid transform put the "
        "marker, grey before, blue with the causes in the model; each touch was left out of its "
        "own fit.",
        parts.by_marker(subject),
        wide=True,
    )


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
    return Picture(
        "joints",
        title,
        f"{what} over the reading of each joint: grey before, blue with the causes in the model. "
        f"Lines are running {line}; a line that is not level says that the error changes along "
        "that joint's travel, whatever part causes it.",
        figures.over_joints(subject),
    )


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
    if not drawn:
        return None
    return Picture(
        "velocity",
        "Residuals over each joint's velocity",
        "A step at zero is dry friction, a slope or a bend friction that grows with the speed."
        if subject.torques
        else "A step at zero is play or friction; a slope is a delay or a drive that yields.",
        drawn,
    )


def _friction(subject: Subject) -> Picture | None:
    drawn = torques.friction(subject)
    if not drawn:
        return None
    return Picture(
        "friction",
        f"Friction of {counted(len(drawn), 'joint')} over the velocity",
        "Lines are the friction of all causes together, with a band of two standard errors on "
        "either side; dots are what the rows have for it, other causes taken away. Where friction "
        "depends on the load it is drawn at the joint's median.",
        drawn,
    )


def _torques(subject: Subject) -> Picture | None:
    drawn = torques.torques(subject) if subject.torques else ()
    if not drawn:
        return None
    return Picture(
        "torques",
        "Torque over time, of the joints that miss it most for their noise",
        "Above: the model alone (grey), what was measured (black, white in the dark) and the model "
        "with its causes "
        "(blue, dashed). Below: what each leaves, on rows that the fit has not seen.",
        drawn,
        wide=True,
    )


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
    return Picture(
        "time",
        title,
        "Grey before, blue after. A line that climbs or jumps tells of drift or of a base that "
        "moved.",
        drawn,
        wide=True,
    )


def _noise(subject: Subject) -> Picture | None:
    noise, unit = subject.verdict.noise, subject.verdict.gap.unit
    title = "Residuals against the noise"
    if np.isfinite(noise.ratio) and subject.verdict.knows_noise:
        left = "what is left" if subject.verdict.verdict != Outcome.NO_GAP else "the residual"
        title = f"Fitted to all rows, {left} is {significant(noise.ratio)} times the noise"
    words = "Single readings' residuals before (grey) and after (blue) as densities."
    if np.isfinite(noise.sigma):
        words += f" The line is the noise: {noise_words(noise, unit)}."
    return Picture("noise", title, words, (figures.against_noise(subject),), wide=True)


MAKERS: tuple[Callable[[Subject], Picture | None], ...] = (
    _where,
    _staircase,
    _ranking,
    _ripples,
    _workspace,
    _beam,
    _planes,
    _markers,
    _joints,
    _velocity,
    _friction,
    _torques,
    _time,
    _noise,
)

"""Pictures of a motion: command, actual, nominal and corrected over time, the residual below."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report.diagnosis import causes
from plumbline.experiments.report.page.page import Picture
from plumbline.experiments.report.style import (
    AFTER,
    BEFORE,
    FAINT,
    INK,
    calm,
    house_style,
    new_figure,
)
from plumbline.kinematics.drive import Law
from plumbline.optim.core.quantities import counted, percent, quantity, scaled
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.rollout import Array
from plumbline.optim.diagnosis.verdict.words import place_words

SHOWN = 3  # joints whose traces are drawn: those with the largest gap
STRETCH = 4  # windows that a trace runs over, some six seconds
WIDTH = 6.4  # [in]


def motion_pictures(found: MotionDiagnosis) -> tuple[Picture, ...]:
    """All pictures of a motion, in the order of the report."""
    made = [make(found) for make in MAKERS]
    return tuple(picture for picture in made if picture is not None)


def _where(found: MotionDiagnosis) -> Picture | None:
    if not found.where:
        return None
    first = found.where[0]
    return Picture(
        "where",
        f"{percent(first.share)} of the explained gap comes from the "
        f"{place_words(first.stage, first.element)}",
        "How much of the square each joint's causes take.",
        (causes.shares(found.verdict),),
        wide=True,
    )


def _staircase(found: MotionDiagnosis) -> Picture | None:
    if not found.causes:
        return None
    return Picture(
        "staircase",
        "The gap as the drives are corrected, one joint after the other",
        "What is left on samples that the fit has not seen, over all joints.",
        (causes.staircase(found.verdict),),
        wide=True,
    )


def _ranking(found: MotionDiagnosis) -> Picture | None:
    if not found.candidates:
        return None
    return Picture(
        "ranking",
        f"{counted(len(found.candidates), 'candidate')} considered, "
        f"{counted(len(found.causes), 'cause')} found",
        "How probable it is that each effect is at work; blue ones are in the verdict.",
        (causes.ranking(found.verdict),),
        wide=True,
    )


def _traces(found: MotionDiagnosis) -> Picture | None:
    if not found.joints:
        return None
    pairs = list(zip(found.joints, found.left_out, strict=True))
    pairs.sort(key=lambda pair: -float(pair[1].before.mean()))
    worst = pairs[0]
    before, after = (
        quantity(float(np.sqrt(s.mean())), found.recording.unit)
        for s in (worst[1].before, worst[1].after)
    )
    return Picture(
        "traces",
        f"{found.recording.noun.capitalize()} {worst[0].number} misses its command by {before}; "
        f"with its causes {after} is left",
        "Some seconds that no fit has seen, of joints with the largest gap. Above: command (grey), "
        "what it did (black) and what the corrected drive foretells (blue, dashed). Below: "
        "what is left of the ideal drive (grey) and of the corrected one (blue).",
        tuple(traces(found, joint.number) for joint, _ in pairs[:SHOWN]),
        wide=True,
    )


def traces(found: MotionDiagnosis, number: int) -> Figure:
    """Command, actual and corrected of a joint (from 1) over time, its residuals below."""
    numbers = [joint.number for joint in found.joints]
    judged = found.left_out[numbers.index(number)]
    part = _stretch(judged.before)
    windows = found.signals.windows(number - 1, judged.starts[part])
    t = found.signals.time[windows.samples].ravel()
    order = np.argsort(t)
    q = windows.measured.ravel()
    left = [r[part].ravel() for r in (judged.residual_before, judged.residual_after)]
    unit, noun = found.recording.unit, found.recording.noun
    rates = found.recording.law not in (Law.POSITION, Law.SERVO)  # of another scale
    command = np.full_like(q, np.nan) if rates else windows.command[windows.samples].ravel()
    with house_style():
        figure = new_figure(WIDTH, 3.2)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        for axes in (upper, lower):
            calm(axes)
        upper.plot(t[order], command[order], color=FAINT, linewidth=2.2)
        upper.plot(t[order], q[order], color=INK, linewidth=1.4)
        upper.plot(t[order], (q + left[1])[order], color=AFTER, linewidth=1.2, linestyle="--")
        upper.set_ylabel(f"{noun} {number} [{unit}]")
        lower.plot(t[order], 1e3 * left[0][order], color=BEFORE, linewidth=1.0)
        lower.plot(t[order], 1e3 * left[1][order], color=AFTER, linewidth=1.0)
        lower.set_ylabel(f"left [{scaled(unit)[1]}]")
        lower.set_xlabel("time [s]")
        return figure


def _stretch(before: Array) -> slice:
    """Some windows in a row in which the gap is as large as it usually is."""
    count = min(STRETCH, len(before))
    sums = np.convolve(before, np.ones(count), "valid")
    at = int(np.argmin(np.abs(sums - np.median(sums))))
    return slice(at, at + count)


# A picture of the report each, None where the motion has nothing for it; named as the key.
MAKERS: tuple[Callable[[MotionDiagnosis], Picture | None], ...] = (
    _traces,
    _where,
    _staircase,
    _ranking,
)

"""Pictures of a motion: command, actual, nominal and corrected over time, the residual below."""

from collections.abc import Callable

import numpy as np
import scipy
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from plumbline.experiments.report.diagnosis import causes
from plumbline.experiments.report.diagnosis.torques import Traces, over_time
from plumbline.experiments.report.page.page import Picture
from plumbline.experiments.report.style import AFTER, FAINT, INK, calm, house_style, new_figure
from plumbline.optim.core.quantities import counted, percent, quantity, scaled
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.rollout import played
from plumbline.optim.diagnosis.motion.windows import Array
from plumbline.optim.diagnosis.verdict.words import place_words

SHOWN = 3  # joints whose traces are drawn: those with the largest gap
STRETCH = 4  # windows that a trace runs over, some six seconds
WIDTH = 6.4  # [in]
SPAN = 10.0  # [s] of a spectrum: frequencies a tenth of a hertz apart
COHERENT = 0.9  # least share of the joint's power that its command explains
POWERFUL = 1e-3  # of the most power that a frequency is commanded with: less is leakage of others


def motion_pictures(found: MotionDiagnosis) -> tuple[Picture, ...]:
    """All pictures of a motion, in the order of the report."""
    made = [make(found) for make in MAKERS]
    return tuple(picture for picture in made if picture is not None)


def _where(found: MotionDiagnosis) -> Picture | None:
    if not found.where:
        return None
    first, drawn = found.where[0], causes.shares(found.verdict)
    words = place_words(first.stage, first.element)
    return Picture.of("motion.where", drawn, share=percent(first.share), first=words)


def _staircase(found: MotionDiagnosis) -> Picture | None:
    told = found.causes
    return Picture.of("motion.staircase", causes.staircase(found.verdict)) if told else None


def _ranking(found: MotionDiagnosis) -> Picture | None:
    if not found.candidates:
        return None
    return Picture.of(
        "motion.ranking",
        causes.ranking(found.verdict),
        considered=counted(len(found.candidates), "candidate"),
        named=counted(len(found.causes), "cause"),
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
    drawn = (traces(found, joint.number) for joint, _ in pairs[:SHOWN])
    joint = f"{found.recording.noun.capitalize()} {worst[0].number}"
    return Picture.of("motion.traces", *drawn, joint=joint, before=before, after=after)


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
    unit, noun = found.recording.units[number - 1], found.recording.noun
    rates = not found.recording.law.follows  # of another scale
    command = np.full_like(q, np.nan) if rates else windows.command[windows.samples].ravel()
    factor, small = scaled(unit)
    return over_time(
        Traces(
            t[order], command[order], q[order], (q + left[1])[order],
            factor * left[0][order], factor * left[1][order],
            f"{noun} {number} [{unit}]", f"left [{small}]",
        )
    )  # fmt: skip


def _bode(found: MotionDiagnosis) -> Picture | None:
    if not found.joints or not found.recording.law.follows:
        return None  # what is commanded and what is measured are of two kinds
    pairs = list(zip(found.joints, found.left_out, strict=True))
    joint = max(pairs, key=lambda pair: float(pair[1].before.mean()))[0]
    drawn = bode(found, joint.number)
    return Picture.of("motion.bode", drawn, joint=joint.number) if drawn is not None else None


def bode(found: MotionDiagnosis, number: int) -> Figure | None:
    """Gain and phase from command to a joint (from 1), measured and of the drive with its causes.

    None where no frequency tells them, as of a single step. By Welch's cross-spectra (1967, IEEE
    Trans. Audio 15(2)), the same of what was measured and of what the drive makes of the whole
    recording's commands.
    """
    joint = next(j for j in found.joints if j.number == number)
    windows = joint.windows
    made = played(windows, joint.fit.effects, joint.fit.theta)
    f, measured, seen = transfer_of(windows.command, windows.q, windows.dt)
    if not seen.any():
        return None
    model = transfer_of(windows.command, made, windows.dt)[1]
    with house_style():
        figure = new_figure(WIDTH, 3.2)
        upper, lower = figure.subplots(2, 1, sharex=True)
        for axes, part, nominal in ((upper, np.abs, 1.0), (lower, _degrees, 0.0)):
            calm(axes)
            axes.axhline(nominal, color=FAINT, linewidth=1.2)
            axes.plot(f[seen], part(measured[seen]), "o", color=INK, markersize=3)
            axes.plot(f[seen], part(model[seen]), color=AFTER, linewidth=1.4)
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
        upper.set_ylabel("gain")
        lower.set(ylabel="phase [deg]", xlabel="frequency [Hz]")
        return figure


def _degrees(transfer: NDArray[np.complex128]) -> Array:
    return np.asarray(np.degrees(np.unwrap(np.angle(transfer))))


def transfer_of(u: Array, q: Array, dt: float) -> tuple[Array, NDArray[np.complex128], Array]:
    """Frequencies [Hz], transfer from u to q, and whether that is told there."""
    span = min(len(u), round(SPAN / dt))
    f, cross = scipy.signal.csd(u, q, 1 / dt, nperseg=span)
    own, other = (
        np.asarray(scipy.signal.welch(x, 1 / dt, nperseg=span)[1], dtype=float) for x in (u, q)
    )
    asked = (f > 0) & (own > POWERFUL * own.max())
    told = asked & (np.abs(cross) ** 2 > COHERENT * own * other)
    return np.asarray(f), np.asarray(cross / np.maximum(own, 1e-300)), told


def _stretch(before: Array) -> slice:
    """Some windows in a row in which the gap is as large as it usually is."""
    count = min(STRETCH, len(before))
    sums = np.convolve(before, np.ones(count), "valid")
    at = int(np.argmin(np.abs(sums - np.median(sums))))
    return slice(at, at + count)


# A picture of the report each, None where the motion has nothing for it; named as the key.
MAKERS: tuple[Callable[[MotionDiagnosis], Picture | None], ...] = (
    _traces, _bode, _where, _staircase, _ranking,
)  # fmt: skip

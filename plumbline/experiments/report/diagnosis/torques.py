"""Efforts of drives: friction over the speed with its band, and the torque of joints over time.

What a joint was expected to do, did, and is foretold to do over time, with what is left below, is
drawn for motions as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from plumbline.experiments.report import style
from plumbline.experiments.report.diagnosis.figures import PANEL, cloud, top_of
from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.experiments.report.style import AFTER, BEFORE, INK, calm, house_style, new_figure
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.findings import FrictionCurve

SHOWN = 3  # joints whose torque is drawn over time: those with the largest gap in their own noise
ROWS = 800  # of a recording that are drawn over time, from its middle
WIDTH, HEIGHT = 6.4, 3.2  # [in]


def friction(subject: Subject) -> tuple[Figure, ...]:
    """A panel a joint that rubs: what each row and the model have for its friction."""
    with house_style():
        return tuple(_friction(subject, curve) for curve in subject.verdict.friction)


def _friction(subject: Subject, curve: FrictionCurve) -> Figure:
    v, torque, std = (np.array(x) for x in (curve.velocity, curve.torque, curve.std))
    assert subject.recording.velocity is not None
    at = subject.recording.velocity[:, curve.joint - 1]
    # What is measured is what the model has less what is left: the other causes are taken away.
    seen = np.interp(at, v, torque) - subject.after[:, curve.joint - 1]
    figure = new_figure(*PANEL)
    axes = figure.add_subplot()
    cloud(axes, at, seen, subject.rows, color=BEFORE, s=4.0)
    for side in (v < 0.0, v > 0.0):
        low, high = (torque + sign * 2.0 * std for sign in (-1.0, 1.0))
        axes.fill_between(v[side], low[side], high[side], color=AFTER, alpha=0.35, linewidth=0)
        axes.plot(v[side], torque[side], color=INK, linewidth=1.4)
    top = max(top_of(np.abs(seen)), 1.1 * float(np.abs(torque).max()))
    axes.set(ylim=(-top, top), title=f"joint {curve.joint}")
    slides = subject.recording.chain.kinds[curve.joint - 1] == "prismatic"
    axes.set(
        xlabel=f"velocity [{'m/s' if slides else 'rad/s'}]", ylabel=f"friction [{subject.unit}]"
    )
    calm(axes)
    return figure


def torques(subject: Subject) -> tuple[Figure, ...]:
    """Measured, modelled and corrected torque of the worst joints over time, what is left below."""
    r = subject.recording
    if r.time is None or r.noise_by_joint is None or not np.ptp(r.time) > 0.0:
        return ()
    rms = np.sqrt(np.nanmean(subject.before**2, axis=0)) / r.noise_by_joint
    middle = np.argsort(r.time, kind="stable")
    first = max((len(middle) - ROWS) // 2, 0)
    part = middle[first : first + ROWS]
    worst = sorted(np.argsort(-rms, kind="stable")[:SHOWN].tolist())
    return tuple(over_time(_traces(subject, r.time, part, j)) for j in worst)


def _traces(subject: Subject, time: Array, part: NDArray[np.intp], j: int) -> Traces:
    measured = subject.factor * subject.recording.measured[part, j]
    before, after = (left[part, j] for left in (subject.before, subject.after))
    names = (f"joint {j + 1} [{subject.unit}]", f"left [{subject.unit}]")
    curves = (time[part], measured + before, measured, measured + after, before, after)
    return Traces(*curves, *names)


@dataclass(frozen=True, eq=False)
class Traces:
    """Curves over time (N,), and what their axes are called.

    Attributes:
        time: When [s], in ascending order.
        nominal: What the ideal model has; NaN where that is of another scale.
        actual: What was measured.
        corrected: What the model with its causes has.
        before: Nominal less actual.
        after: Corrected less actual.
        what: Name of the upper axis, with its unit.
        left: Name of the lower axis, with its unit.
    """

    time: Array
    nominal: Array
    actual: Array
    corrected: Array
    before: Array
    after: Array
    what: str
    left: str


def over_time(traces: Traces) -> Figure:
    """The curves, residuals below."""
    t = traces.time
    with style.house_style():
        figure = style.new_figure(WIDTH, HEIGHT)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        for axes in (upper, lower):
            style.calm(axes)
        upper.plot(t, traces.nominal, color=style.FAINT, linewidth=2.2)
        upper.plot(t, traces.actual, color=style.INK, linewidth=1.4)
        upper.plot(t, traces.corrected, color=style.AFTER, linewidth=1.2, linestyle="--")
        upper.set_ylabel(traces.what)
        lower.plot(t, traces.before, color=style.BEFORE, linewidth=1.0)
        lower.plot(t, traces.after, color=style.AFTER, linewidth=1.0)
        lower.set(ylabel=traces.left, xlabel="time [s]")
        return figure

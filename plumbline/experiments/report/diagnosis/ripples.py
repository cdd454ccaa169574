"""Ripples of joints as curves over the joint's angle, each with a band of two standard errors."""

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report.style import AFTER, INK, calm, house_style, new_figure
from plumbline.optim.diagnosis.findings import Cause, Verdict

MOST_CURVES = 6
WIDTH, HEIGHT = 5.2, 1.5  # [in], the height of one curve
MRAD = 1e3  # of a radian


def with_curves(verdict: Verdict) -> tuple[Cause, ...]:
    """The causes that are curves, the largest first."""
    found = [cause for cause in verdict.causes if cause.curve is not None]
    return tuple(sorted(found, key=lambda cause: -_size(cause))[:MOST_CURVES])


def _size(cause: Cause) -> float:
    return max(map(abs, cause.curve.value)) if cause.curve else 0.0


def curves(causes: tuple[Cause, ...]) -> Figure:
    """One row a cause: its error [mrad] over the joint's angle [rad], and the band."""
    with house_style():
        figure = new_figure(WIDTH, 0.5 + HEIGHT * len(causes))
        rows = figure.subplots(len(causes), 1, squeeze=False)[:, 0]
        for axes, cause in zip(rows, causes, strict=True):
            assert cause.curve is not None
            angle, value, std = map(
                np.array, (cause.curve.angle, cause.curve.value, cause.curve.std)
            )
            low, high = (MRAD * (value + side * 2.0 * std) for side in (-1.0, 1.0))
            axes.fill_between(angle, low, high, color=AFTER, alpha=0.25, linewidth=0)
            axes.plot(angle, MRAD * value, color=INK, linewidth=1.0)
            axes.set_title(cause.label, loc="left")
            axes.set_ylabel("mrad")
            calm(axes)
        rows[-1].set_xlabel("joint's reading [rad]")
        return figure

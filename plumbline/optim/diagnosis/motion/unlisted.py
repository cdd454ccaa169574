r"""The rival of every cause: a function that nobody has listed, of one thing that a joint goes by.

With :math:`n_e` effective samples and features :math:`\Phi` (bumps along the variable, and the same
times the sign of the speed), the residual is :math:`r = \Phi w + J z + \epsilon`,
:math:`w \sim N(0, \tau^2 I)`, summed over a grid of :math:`\tau`; z lets the named causes give way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.optim.diagnosis.motion.constants import BUMPS, WIDTHS
from plumbline.optim.diagnosis.motion.fit import Fit
from plumbline.optim.diagnosis.motion.rollout import Array, Windows

VARIABLES = ("velocity", "load", "angle", "command", "time")


@dataclass(frozen=True)
class Unlisted:
    """How much a function of one variable would explain.

    Attributes:
        on: The variable.
        gain: Log evidence that it adds.
        share: Share of the residual's square that it takes.
    """

    on: str
    gain: float
    share: float


def rivals(windows: Windows, fit: Fit, effective: float, floor: float) -> tuple[Unlisted, ...]:
    """Every variable's function beside a fit."""
    return tuple(_rival(windows, fit, effective, floor, on) for on in VARIABLES)


def _rival(windows: Windows, fit: Fit, effective: float, floor: float, on: str) -> Unlisted:
    r = fit.residual.ravel()
    share = effective / max(len(r), 1)
    Phi = windows.integrated(_features(windows, fit, on))
    J = fit.flat * fit.scales
    variance = fit.square + floor**2
    both = np.hstack([J, Phi])
    G, b = both.T @ both * share / variance, both.T @ r * share / variance
    p = J.shape[1]
    gains, shares = [], []
    for width in WIDTHS:
        precision = np.concatenate([np.ones(p), np.full(Phi.shape[1], 1 / (width**2 * variance))])
        A = G + np.diag(precision)
        w = np.linalg.solve(A, b)
        left = float(np.mean((r - both @ w) ** 2))
        # The noise is integrated out, as in a fit's own evidence.
        better = effective / 2 * np.log((fit.square + floor**2) / (left + floor**2))
        gains.append(better - np.linalg.slogdet(A / precision[:, None])[1] / 2)
        gains[-1] += np.linalg.slogdet(G[:p, :p] + np.eye(p))[1] / 2
        shares.append(1 - left / max(fit.square, 1e-300))
    best = int(np.argmax(gains))
    return Unlisted(on, float(np.logaddexp.reduce(gains) - np.log(len(WIDTHS))), shares[best])


def _features(windows: Windows, fit: Fit, on: str) -> Array:
    """Bumps along a variable, and those of either direction (n, 2 BUMPS).

    Positions and speeds are the predicted ones: measured ones would know what happened.
    """
    at = windows.samples
    predicted = windows.measured + fit.residual
    speed = np.gradient(predicted, windows.dt, axis=1)
    values = {
        "velocity": speed,
        "load": windows.load[at],
        "angle": predicted,
        "command": windows.command[at],
        "time": at * windows.dt,
    }[on].ravel()
    low, high = np.quantile(values, [0.01, 0.99])
    if not high > low:
        return np.zeros((len(values), 0))
    place = np.linspace(0, 1, BUMPS)
    far = ((values - low) / (high - low))[:, None] - place
    bumps = np.exp(-0.5 * far**2 * (BUMPS - 1) ** 2)
    if on in ("velocity", "time"):
        return bumps
    return np.hstack([bumps, bumps * np.sign(speed.ravel())[:, None]])

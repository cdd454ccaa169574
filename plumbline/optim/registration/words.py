"""How far a registration can be trusted at a target, in words."""

from __future__ import annotations

import numpy as np

from plumbline.optim.registration.answer import Registration
from plumbline.optim.registration.constants import (
    COARSE,
    DOUBTFUL,
    ENOUGH_FREEDOMS,
    FINE,
    SURPRISING,
)
from plumbline.optim.registration.target import TargetError


def trust(answer: Registration, error: TargetError, label: str) -> str:
    """One sentence: how far off the target may be, and what limits it."""
    if error.unknown:
        return f"{label}: not known; {error.unknown}"
    far = error.reach
    sentence = (
        f"{label}: {_grade(answer, far)}; in 95 of 100 cases it lies within {far * 1e3:.2g} mm of "
        f"where the transform puts it (RMS {error.rms * 1e3:.2g} mm)"
    )
    limits = _limits(answer, error)
    return f"{sentence}{'; ' if limits else ''}{' and '.join(limits)}"


def _grade(answer: Registration, far: float) -> str:
    """What the region's reach [m] is worth; misfits that belie what was stated make it doubtful."""
    if answer.surprise < DOUBTFUL:
        return "doubtful"
    unsure = (
        _freedoms(answer) < ENOUGH_FREEDOMS or _unchecked(answer) or answer.surprise < SURPRISING
    )
    return "good" if far <= FINE and not unsure else "fair" if far <= COARSE else "poor"


def _freedoms(answer: Registration) -> float:
    """Freedoms by which misfits tell the noise, or check what was stated of it."""
    if answer.unstated is not None:
        return float(answer.unstated.freedoms.min())
    return np.inf if np.isinf(answer.dof) else 3.0 * _kept(answer) - 6.0


def _kept(answer: Registration) -> int:
    return len(answer.labels) - len(answer.shifted)


def _unchecked(answer: Registration) -> bool:
    """Three markers fit a moved one as well."""
    return _kept(answer) == 3


def _limits(answer: Registration, error: TargetError) -> list[str]:
    """What keeps it from being better, or from being known better."""
    found = []
    if 2.0 * answer.tre(error.ct).rms ** 2 < error.rms**2:
        found.append("most of it is how well the target itself is read in CT")
    arm = float(np.linalg.norm(error.robot - answer.centre))
    turned = arm * np.sqrt(np.trace(answer.covariance[3:6, 3:6]))
    if turned > 2.0 * np.sqrt(np.trace(answer.covariance[:3, :3])):
        found.append(
            f"most of the transform's part comes from the rotation over an arm of {arm * 1e3:.0f} "
            "mm: put markers farther apart, and around the target"
        )
    if np.isnan(answer.surprise):
        found.append(
            f"the noise itself is estimated from {answer.dof:.0f} misfits: state the CT's "
            "resolution and the robot's std"
        )
    if _unchecked(answer):
        found.append("three markers cannot show that one of them moved")
    elif answer.unstated is None and _freedoms(answer) < ENOUGH_FREEDOMS:
        found.append(f"{_kept(answer)} markers hardly check what was stated of the noise")
    if answer.surprise < DOUBTFUL:
        found.append("the markers misfit more than the stated noise allows, so it may be worse")
    elif answer.surprise < SURPRISING:
        found.append(
            f"fewer than {SURPRISING:.0%} of markers misfit so much under the stated noise: it is "
            f"taken for {answer.noise_scale:.2g} times as large; check what was stated"
        )
    return found

"""The noise: as stated, from repeated readings, or from what the fit leaves over.

Readings are repeated where posture, side of approach and payload are the same. What they differ by
besides the fit is noise, unless it is an effect of time or of the path that the fit lacks; so they
never count for more, chance aside, than all that the fit leaves.
"""

from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from plumbline.optim.core.judged import Solution
from plumbline.optim.core.mapped import Gram
from plumbline.optim.diagnosis.findings import NoiseLevel
from plumbline.optim.diagnosis.prior import ALARM, FEWEST_REPEATS, FINEST, ROUNDING
from plumbline.optim.measurement.correlated import postures
from plumbline.optim.measurement.refit import scattered
from plumbline.optim.measurement.torque import stated_noise
from plumbline.optim.recording.recording import Recording


def noise_of(recording: Recording, best: Solution) -> NoiseLevel:
    """One standard deviation of one measured axis, and the residual's ratio to it."""
    rows = best.gram - best.mapped.shared_gram(best.x)
    # What joints scatter by is no noise of the device, as it was stated.
    residual = scatter_of(best, rows) * scattered(recording)
    known = stated_noise(recording)
    if known:
        stated = max(known, ROUNDING)
        return NoiseLevel(stated, "given", residual / stated)
    repeats = repeat_noise(recording, best)
    residual = max(residual, FINEST)
    if repeats is not None and FINEST < repeats.sigma <= residual * (1.0 + _chance(repeats)):
        return replace(repeats, ratio=residual / repeats.sigma)
    return NoiseLevel(residual, "fit", 1.0)


def scatter_of(best: Solution, rows: Gram) -> float:
    """Standard deviation of what a fit leaves of rows, some or all, less what it has used up."""
    return float(np.sqrt(rows.square / max(rows.count - _used(best, rows), 1.0)))


def _used(best: Solution, rows: Gram) -> float:
    """How many readings the fit has used up: the trace of its hat matrix."""
    scale = np.sqrt(np.maximum(np.diag(best.gram.matrix), 1e-300))
    size = np.outer(scale, scale)
    ridge = 1e-12 * np.eye(len(scale))
    return float(np.trace(np.linalg.solve(best.gram.matrix / size + ridge, rows.matrix / size)))


def repeat_noise(recording: Recording, best: Solution) -> NoiseLevel | None:
    """Pooled spread [m] of residuals of repeated readings; None with too few of them."""
    kind = recording.kind
    if not (kind.device or kind.fiducials) or recording.alike:
        return None
    trusted = best.problem.weights > 0
    _, label, count = np.unique(
        postures(recording)[trusted], return_inverse=True, return_counts=True
    )
    freedom = int((count - 1).sum())
    if freedom < FEWEST_REPEATS:
        return None
    label = label.ravel()
    r = best.mapped.residuals(best.x)[trusted, :3]
    means = np.stack([np.bincount(label, r[:, c]) / count for c in range(3)], axis=1)
    square = float(((r - means[label]) ** 2).sum())
    return NoiseLevel(float(np.sqrt(square / (3 * freedom))), "repeats", 1.0, repeats=freedom)


def _chance(noise: NoiseLevel) -> float:
    """By how much repeats may say more than the fit leaves: as far as chance may go."""
    return float(-ndtri(ALARM)) * float(np.sqrt(0.5 / (3 * noise.repeats)))

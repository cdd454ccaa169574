"""The noise: as stated, from repeated postures, or from what the fit leaves over."""

from __future__ import annotations

import numpy as np

from optim.diagnosis.verdict import Noise
from optim.mapped import Gram
from optim.recording import Recording
from optim.solution import Solution

SAME_POSTURE = 1e-6
FEWEST_REPEATS = 6


def noise_of(recording: Recording, best: Solution) -> Noise:
    """One standard deviation of one measured axis, and the residual's ratio to it."""
    problem = best.problem
    rows = sum(best.mapped.grams(best.x), start=Gram.empty(problem.size))
    used = _used(best, rows)
    residual = float(np.sqrt(rows.square / max(rows.count - used, 1.0)))
    repeats = repeat_noise(recording, problem.weights > 0)
    if recording.noise_std:
        sigma, source = recording.noise_std, "given"
    elif repeats is not None:
        sigma, source = repeats, "repeats"
    else:
        sigma, source = residual, "fit"
    return Noise(sigma, source, residual / sigma if sigma else float("nan"))


def _used(best: Solution, rows: Gram) -> float:
    """How many readings the fit has used up: the trace of its hat matrix."""
    scale = np.sqrt(np.maximum(np.diag(best.gram.matrix), 1e-300))
    size = np.outer(scale, scale)
    ridge = 1e-12 * np.eye(len(scale))
    return float(np.trace(np.linalg.solve(best.gram.matrix / size + ridge, rows.matrix / size)))


def repeat_noise(recording: Recording, trusted: np.ndarray) -> float | None:
    """Pooled spread [m] or [rad] of readings at the same posture; None with too few repeats."""
    if recording.observation not in ("tip_position", "pose"):
        return None
    keys = np.round(recording.q[trusted] / SAME_POSTURE).astype(np.int64)
    _, label, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    freedom = int((count - 1).sum())
    if freedom < FEWEST_REPEATS:
        return None
    y = recording.measured[trusted, :3]
    means = np.stack([np.bincount(label.ravel(), y[:, c]) / count for c in range(3)], axis=1)
    square = float(((y - means[label.ravel()]) ** 2).sum())
    return float(np.sqrt(square / (3 * freedom)))

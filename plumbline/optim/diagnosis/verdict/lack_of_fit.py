"""Whether what the causes leave exceeds any noise that may be: lack of fit."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from plumbline.optim.diagnosis.findings import Gap, NoiseLevel
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.predict.held_out import Evaluation
from plumbline.optim.diagnosis.prior import ANISOTROPY, KNOWN_NOISE_FREEDOM, LACKING, LACKING_SLOPE
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import plausible


def lack_of_fit(noise: NoiseLevel, selected: SelectedModel) -> float:
    """Probability-like measure that the residual exceeds any noise that may be.

    A noise that is implausible is none. A stated sigma is believed to seven per cent, one from
    repeats as far as their number allows; half is reached at two and a half deviations.
    """
    if noise.sigma > plausible(selected.model.recording):
        return 1.0
    if noise.source == "fit":
        return 0.0
    n = max(selected.best.gram.count - selected.best.problem.size, 1.0)
    known = 0.5 / (3 * noise.repeats) if noise.repeats else 0.5 / KNOWN_NOISE_FREEDOM
    spread = float(np.sqrt(known + 0.5 / n))
    return float(expit(LACKING_SLOPE * ((noise.ratio - 1.0) / spread - LACKING)))


def implausible_noise(
    recording: Recording, noise: NoiseLevel, evaluation: Evaluation, *, timed: bool
) -> float:
    """What is taken for noise [m or rad] where no set-up that is right leaves as much; else 0.

    Where nothing but the fit tells the noise, rows left out tell how much of it the fit hides,
    unless a cause runs with time, which they do not foretell.
    """
    left = noise.sigma
    if noise.source == "fit" and not timed:
        left = max(left, evaluation.rms_after / evaluation.per_point)
    return left if left > plausible(recording) else 0.0


def is_far(gap: Gap, noise: NoiseLevel) -> bool:
    """Whether rows left out are missed by far more than their noise, whatever the fit leaves."""
    return noise.source != "fit" and gap.is_far


def noisiest_joint(recording: Recording, selected: SelectedModel) -> str:
    """What is said where a joint's second encoder scatters more than the others', if one does."""
    if not recording.kind.encoders:
        return ""
    r = selected.best.mapped.residuals(selected.best.x)[selected.best.problem.weights > 0]
    each = np.sqrt(np.mean(r**2, axis=0))
    k = int(np.argmax(each))
    if each[k] ** 2 < ANISOTROPY * float(np.mean(each**2)):
        return ""
    return f"joint {recording.measured_joints[k] + 1}'s error changes from reading to reading"

r"""Whether rows know of each other, or err with their speed: by evidence, of what a state leaves.

What is left of m components a row is Gaussian with correlation :math:`\rho^d` between rows d apart,
or c between readings of one posture, or wider along a row's motion by what its clock is uncertain
of (:mod:`plumbline.optim.measurement.clock`). With R its correlation matrix and the noise's size
integrated out, of which a statement says nothing here: where it is too large, rows would seem
alike,

.. math:: \log p = -\tfrac12 \log\det R - \tfrac n2 \log \mathrm{tr}\, e^T R^{-1} e

is tried over a grid, and a correlation is taken only where the data ask for it (Schwarz 1978). As
the state may hold slow functions of time and whatever else the library lacks, all that these
explain may be theirs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.mapped import less_foretold
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.prior import CORRELATIONS, JITTERS, NOISE_NEGLIGIBLE
from plumbline.optim.measurement.clock import along, less_smeared
from plumbline.optim.measurement.correlated import follows_of, postures
from plumbline.optim.recording.recording import Recording

Correlation = tuple[float, float, float]  # wander, alike and jitter of a recording
Tried = dict[Correlation, float]


def correlation_of(
    left: Array,
    recording: Recording,
    noise: NoisePrior,
    v: Array | None = None,
    *,
    in_order: bool = True,
) -> tuple[Correlation, float]:
    """What is asked for, and its log odds against the recording's own.

    Args:
        left: What a state leaves (N, m), as measured.
        recording: These rows.
        noise: The prior of the noise.
        v: How fast the rows move (N, m), where it may be their clock that errs.
        in_order: Whether rows may wander, or be alike, with what comes before them.
    """
    posture = postures(recording)
    tried: Tried = {(0.0, 0.0, 0.0): _wandering(left, recording, noise, 0.0)}
    price = NOISE_NEGLIGIBLE + 0.5 * np.log(max(left.size, 2))
    for r in CORRELATIONS if in_order else ():
        tried[r, 0.0, 0.0] = _wandering(left, recording, noise, r) - price
        if not np.array_equal(posture, np.arange(len(left))):
            tried[0.0, r, 0.0] = _alike(left, posture, noise, r) - price
    v = np.zeros_like(left) if v is None else v
    for ratio in JITTERS if v.any() else ():
        size = ratio / float(np.sqrt(np.mean(v**2)))
        tried[0.0, 0.0, size] = _late(left, v, noise, size) - price
    best = max(tried, key=lambda found: tried[found])
    now = (recording.wander, recording.alike, recording.jitter)
    near = min(tried, key=lambda found: float(np.abs(np.subtract(found, now)).sum()))
    return best, tried[best] - tried[near]


def _log_likelihood(
    square: float, log_det: float, trace: float, left: Array, least: float
) -> float:
    """Of what is left, from its whitened square, and R of all of it: its determinant, tr R^-1.

    What rounding leaves, or the finest device, is white.
    """
    known = max(square, trace * least**2)
    return -0.5 * (log_det + left.size * float(np.log(known)))


def _late(left: Array, v: Array, noise: NoisePrior, jitter: float) -> float:
    s = jitter**2 * np.sum(v**2, axis=1)
    square = float(np.sum(less_smeared(left, along(v, jitter)) ** 2))
    trace = left.size - float(np.sum(s / (1.0 + s)))
    return _log_likelihood(square, float(np.log1p(s).sum()), trace, left, noise.least)


def _wandering(left: Array, recording: Recording, noise: NoisePrior, rho: float) -> float:
    follows, m = follows_of(recording, rho=rho), left.shape[1]
    white = less_foretold(left, np.zeros_like(left[:1]), follows) if follows.size else left
    log_det = m * float(np.log1p(-(follows**2)).sum())
    trace = left.size + 2.0 * m * float(np.sum(follows**2 / (1.0 - follows**2)))
    return _log_likelihood(float(np.sum(white**2)), log_det, trace, left, noise.least)


def _alike(left: Array, posture: NDArray[np.intp], noise: NoisePrior, c: float) -> float:
    count, m = np.bincount(posture), left.shape[1]
    means = np.stack([np.bincount(posture, e) / count for e in left.T], axis=1)
    own = 1.0 + (count - 1.0) * c
    square = float(np.sum((left - means[posture]) ** 2)) / (1.0 - c)
    square += float(np.sum((count / own)[:, None] * means**2))
    log_det = m * float(np.sum((count - 1.0) * np.log1p(-c) + np.log(own)))
    trace = m * float(np.sum((count - 1.0) / (1.0 - c) + 1.0 / own))
    return _log_likelihood(square, log_det, trace, left, noise.least)

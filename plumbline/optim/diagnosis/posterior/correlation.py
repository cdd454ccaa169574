r"""Whether rows know of each other: by evidence, from what the best state leaves.

What is left of m components a row is Gaussian with correlation :math:`\rho^d` between rows d apart,
or c between readings of one posture. With R its correlation matrix and the noise's size integrated
out, of which a statement says nothing here: where it is too large, rows would seem alike,

.. math:: \log p = -\tfrac m2 \log\det R - \tfrac n2 \log \mathrm{tr}\, e^T R^{-1} e

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
from plumbline.optim.diagnosis.prior import CORRELATIONS, NOISE_NEGLIGIBLE
from plumbline.optim.measurement.correlated import follows_of, postures
from plumbline.optim.recording.recording import Recording

Correlation = tuple[float, float]  # of successive rows' noise, and of one posture's readings


def correlation_of(
    left: Array, recording: Recording, noise: NoisePrior
) -> tuple[Correlation, float]:
    """The correlation that is asked for, and its log odds against the recording's own.

    Args:
        left: What a state leaves (N, m).
        recording: These rows.
        noise: The prior of the noise.
    """
    rows, posture = np.arange(len(left)), postures(recording)
    tried = {(0.0, 0.0): _wandering(left, recording, noise, 0.0)}
    price = NOISE_NEGLIGIBLE + 0.5 * np.log(max(left.size, 2))
    for r in CORRELATIONS:
        tried[r, 0.0] = _wandering(left, recording, noise, r) - price
        if not np.array_equal(posture, rows):
            tried[0.0, r] = _alike(left, posture, noise, r) - price
    best = max(tried, key=lambda found: tried[found])
    now = (recording.wander, recording.alike)
    return best, tried[best] - tried.get(now, tried[0.0, 0.0])


def _log_likelihood(
    square: float, log_det: float, trace: float, left: Array, least: float
) -> float:
    """Of what is left, from its whitened square, and R of one component: its determinant, tr R^-1.

    What rounding leaves, or the finest device, is white.
    """
    known = max(square, left.shape[1] * trace * least**2)
    return -0.5 * (left.shape[1] * log_det + left.size * float(np.log(known)))


def _wandering(left: Array, recording: Recording, noise: NoisePrior, rho: float) -> float:
    follows = follows_of(recording, rho=rho)
    white = less_foretold(left, np.zeros_like(left[:1]), follows) if follows.size else left
    log_det = float(np.log1p(-(follows**2)).sum())
    trace = len(left) + 2.0 * float(np.sum(follows**2 / (1.0 - follows**2)))
    return _log_likelihood(float(np.sum(white**2)), log_det, trace, left, noise.least)


def _alike(left: Array, posture: NDArray[np.intp], noise: NoisePrior, c: float) -> float:
    count = np.bincount(posture)
    means = np.stack([np.bincount(posture, e) / count for e in left.T], axis=1)
    own = 1.0 + (count - 1.0) * c
    square = float(np.sum((left - means[posture]) ** 2)) / (1.0 - c)
    square += float(np.sum((count / own)[:, None] * means**2))
    log_det = float(np.sum((count - 1.0) * np.log1p(-c) + np.log(own)))
    trace = float(np.sum((count - 1.0) / (1.0 - c) + 1.0 / own))
    return _log_likelihood(square, log_det, trace, left, noise.least)

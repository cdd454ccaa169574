r"""The variance of one reading's equation, and how much each reading then counts.

A range of variance :math:`\sigma_d^2 + (g \tan\theta)^2`, its second part from the spot that
spreads over depths, moves the point along the beam; across the plane that is times
:math:`\cos^2\theta`. Flange and board add a constant:

.. math:: \sigma^2(\theta) = a + b \sin^2\theta

exactly, with a and b free. Both are found by maximum likelihood from what the fit leaves over
(expectation-maximisation: the residual's square, and what the unknowns' own uncertainty hides).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.constants import (
    LEAST_FOR_SLOPE,
    LEAST_SLANT,
    VARIANCE_FLOOR,
    VARIANCE_ROUNDS,
)

LEAST = 1e-12  # of the largest square: no reading is exact


@dataclass(frozen=True)
class Variance:
    """Variance of a reading's equation over its incidence."""

    normal: float  # a, at normal incidence [m^2]
    slant: float = 0.0  # b, added in proportion to sin^2 of the incidence [m^2]

    def at(self, incidence: Array) -> Array:
        """Variances (N,) [m^2] at angles (N,) [rad]."""
        grown = self.normal + self.slant * np.sin(incidence) ** 2
        return np.asarray(np.maximum(grown, VARIANCE_FLOOR * self.normal))


def fit_variance(squares: Array, incidence: Array) -> Variance:
    """The variance of largest likelihood, given expected squares of errors (N,) [m^2].

    Fisher scoring: least squares of the squares over (1, sin^2), weighted by the inverse variance
    squared. Neither variance, at normal nor at the largest incidence, falls below a twentieth of
    the mean.
    """
    slope = np.sin(incidence) ** 2
    mean = max(float(np.mean(squares)), np.finfo(float).tiny)
    most = float(slope.max(initial=0.0))
    if most < LEAST_SLANT or len(squares) < LEAST_FOR_SLOPE:
        return Variance(mean)
    A = np.column_stack([np.ones_like(slope), slope])
    found = np.array([mean, 0.0])
    for _ in range(VARIANCE_ROUNDS):
        w = 1.0 / np.maximum(A @ found, LEAST * mean) ** 2
        normal = (A * w[:, None]).T @ A
        found = np.linalg.solve(normal, A.T @ (w * squares))
        low = VARIANCE_FLOOR * mean
        a = max(found[0], low)
        far = max(a + most * found[1], low)
        found = np.array([a, (far - a) / most])
    return Variance(float(found[0]), float(found[1]))

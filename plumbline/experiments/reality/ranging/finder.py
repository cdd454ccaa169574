r"""The range finder on the flange, and what it reads.

.. math:: d = d_{true} + k\, s\, (1/\cos\theta - 1) + e, \qquad
          e \sim N(0,\ \sigma^2 + (g\, s \tan\theta)^2)

A spot of diameter s that meets a face at the angle theta from its normal covers depths of
s tan(theta): a share g of them is noise, a share k of the spot's growth is bias. Gross errors are
readings of something else: a second reflection, a speck, an edge.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Array


@dataclass(frozen=True, eq=False)
class Finder:
    """A range finder bolted to a flange."""

    r: Array  # (3,) where its beam starts, in the flange frame [m]
    v: Array  # (3,) unit direction of its beam, in the flange frame
    noise: float = 0.05e-3  # repeatability at normal incidence, 1 sigma [m]
    spot: float = 1.6e-3  # diameter of the spot [m]
    grain: float = 0.05  # share of the depths under the spot that is noise
    skew: float = 0.03  # share of the spot's growth that is bias
    shortest: float = 0.2  # least range that it reads [m]
    longest: float = 1.0  # largest range that it reads [m]

    def beams(self, flange: Array) -> tuple[Array, Array]:
        """Origins (N, 3) [m] and directions (N, 3) of the beam at flange poses (N, 4, 4)."""
        return flange[:, :3, :3] @ self.r + flange[:, :3, 3], flange[:, :3, :3] @ self.v

    def read(self, distance: Array, cosine: Array, rng: np.random.Generator) -> Array:
        """Readings (N,) [m] of true distances (N,) [m] at incidences of these cosines (N,)."""
        tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / cosine
        spread = np.hypot(self.noise, self.grain * self.spot * tangent)
        bias = self.skew * self.spot * (1.0 / cosine - 1.0)
        return np.asarray(distance + bias + spread * rng.normal(size=len(distance)))

    def reaches(self, distance: Array) -> NDArray[np.bool_]:
        """Which distances (N,) [m] are within its range."""
        return np.asarray((distance >= self.shortest) & (distance <= self.longest))


def spoil(
    readings: Array, share: float, rng: np.random.Generator, least: float = 2e-3, most: float = 3e-2
) -> tuple[Array, NDArray[np.intp]]:
    """Make a share of readings (N,) [m] grossly wrong, by `least` to `most` either way [m].

    The readings, and the rows spoilt (from 0).
    """
    count = round(share * len(readings))
    rows = np.sort(rng.choice(len(readings), size=count, replace=False))
    spoilt = readings.copy()
    push = np.exp(rng.uniform(np.log(least), np.log(most), count))
    spoilt[rows] += push * rng.choice([-1.0, 1.0], count)
    return spoilt, rows

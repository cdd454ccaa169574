r"""The range finder on the flange, what it reads, and the boards that it looks at.

.. math:: d = d_{true} + k\, s\, (1/\cos\theta - 1) + e, \qquad
          e \sim N(0,\ \sigma^2 + (g\, s \tan\theta)^2)

A spot of diameter s that meets a face at the angle theta from its normal covers depths of
s tan(theta): a share g of them is noise, a share k of the spot's growth is bias. Gross errors are
readings of something else: a second reflection, a speck, an edge.

A flat board is not quite flat,

.. math:: h(x, y) = s \sum_{2 \le i + j \le 5} \frac{a_{ij}}{i^2 + j^2}
          \cos\frac{\pi i (x / w + 1)}{2} \cos\frac{\pi j (y / l + 1)}{2}

over a board of half sides w and l: what a plate does that was bent or bolted down, its long waves
the largest. Shift and tilt (i + j < 2) are the board's pose and no unflatness.
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


ORDERS = tuple((i, j) for i in range(6) for j in range(6) if 2 <= i + j <= 5)


@dataclass(frozen=True, eq=False)
class Board:
    """A board on its place."""

    centre: Array  # (3,) middle of its face in the base frame [m]
    axes: Array  # (3, 3) its x, y and outward normal, as columns, in the base frame
    half: Array  # (2,) half sides [m]
    bumps: Array  # (len(ORDERS),) amplitudes of the waves [m]

    @property
    def normal(self) -> Array:
        """(3,) outward normal, towards the arm."""
        return self.axes[:, 2]

    def at(self, places: Array) -> Array:
        """Points of the face (N, 3) in the base frame, at places (N, 2) on the board [m]."""
        local = np.column_stack([places, self.height(places)])
        return self.centre + local @ self.axes.T

    def height(self, places: Array) -> Array:
        """How far the face stands out (N,) [m] at places (N, 2) [m]."""
        return np.asarray(_waves(places / self.half) @ self.bumps)

    def hit(self, origins: Array, beams: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Distances (N,) [m] at which beams meet the face, normals there (N, 3), and which met it.

        Beams start at (N, 3) [m] and have unit directions (N, 3).
        """
        slope = beams @ self.normal
        gap = (self.centre - origins) @ self.normal
        distance = gap / slope
        for _ in range(6):  # the face is nearly level: a few rounds settle it
            places = self._places(origins + distance[:, None] * beams)
            distance = (gap + self.height(places)) / slope
        places = self._places(origins + distance[:, None] * beams)
        met = (slope < 0.0) & (distance > 0.0) & np.all(np.abs(places) <= self.half, axis=1)
        return distance, self._normals(places), met

    def _places(self, points: Array) -> Array:
        return np.asarray((points - self.centre) @ self.axes[:, :2])

    def _normals(self, places: Array) -> Array:
        step = 1e-4
        shifts = step * np.eye(2)
        up = [(self.height(places + s) - self.height(places - s)) / (2 * step) for s in shifts]
        local = np.column_stack([-up[0], -up[1], np.ones(len(places))])
        local /= np.linalg.norm(local, axis=1, keepdims=True)
        return np.asarray(local @ self.axes.T)


def _waves(places: Array) -> Array:
    """The waves (N, len(ORDERS)) at places (N, 2), -1 to 1 over the board."""
    half_turns = np.pi * (places + 1.0) / 2.0
    along = np.cos(half_turns[:, :1] * np.arange(6)), np.cos(half_turns[:, 1:] * np.arange(6))
    return np.stack([along[0][:, i] * along[1][:, j] for i, j in ORDERS], axis=1)


def draw_bumps(flatness: float, rng: np.random.Generator) -> Array:
    """Amplitudes whose face departs by `flatness` [m] from its plane, root mean square."""
    sizes = 1.0 / np.array([i * i + j * j for i, j in ORDERS])
    bumps = sizes * rng.normal(size=len(ORDERS))
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-0.9, 0.9, 15)]), axis=-1).reshape(-1, 2)
    heights = _waves(grid) @ bumps
    plane = np.column_stack([grid, np.ones(len(grid))])
    rest = heights - plane @ np.linalg.lstsq(plane, heights, rcond=None)[0]
    return np.asarray(flatness * bumps / np.sqrt(np.mean(rest**2)))

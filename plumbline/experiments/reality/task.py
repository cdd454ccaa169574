r"""A task for several instruments: who stands where, who goes where, what is in the way; in mm.

An obstacle that moves drifts, swings, or both,

.. math:: O(t) = O_0 + v\, t + A \sin(\omega t + \varphi)
"""

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.instruments import Instruments, Mismatch
from plumbline.experiments.reality.touch import Touch, all_pairs, point_distances, segment_distances

DEPTHS = (17.0, 225.0)  # [mm] behind the trocar of starts and goals, of 15 to 230 that are allowed
STEEP = 65.0  # [deg] off the vertical, at most, that a shaft starts and ends with
BRISK = 60.0  # [mm/s] of a tip that goes straight to its goal
WAY = 25  # places on the straight way
LOOKED = 0.005  # [s] between the moments at which a start or goal is tried


@dataclass(frozen=True)
class Swing:
    """A capsule that moves to and fro, or stands still."""

    ends: Array  # both ends at rest (2, 3) [mm]; the same twice for a sphere
    radius: float  # its radius [mm]
    way: Array  # how far it swings (3,) [mm]
    rate: float = 0.0  # angular rate [rad/s]
    phase: float = 0.0  # at time zero [rad]
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)  # its mean velocity (3,) [mm/s]

    def at(self, time: float) -> tuple[Array, Array]:
        """Ends (2, 3) [mm] and velocity (3,) [mm/s]."""
        angle, drift = self.rate * time + self.phase, np.array(self.drift)
        velocity = drift + self.rate * self.way * np.cos(angle)
        return self.ends + drift * time + self.way * np.sin(angle), velocity

    def along(self, times: Array) -> Array:
        """Ends (T, 2, 3) [mm] at times (T,)."""
        off = np.sin(self.rate * times + self.phase)[:, None] * self.way
        return self.ends + (off + times[:, None] * np.array(self.drift))[:, None]

    @property
    def speed(self) -> float:
        """The most that it moves at [mm/s]."""
        return float(np.linalg.norm(self.drift) + self.rate * np.linalg.norm(self.way))


@dataclass(frozen=True)
class Scenario:
    """A task."""

    family: str  # what kind
    seed: int  # what it was drawn from
    instruments: Instruments  # trocars, lengths, radii
    starts: Array  # tips at the start (I, 3) [mm]
    goals: Array  # tips wanted (I, 3) [mm]
    obstacles: tuple[Swing, ...]  # what is in the way
    mismatch: Mismatch  # how the plant differs from the model

    def touch(self) -> Touch:
        """All pairs that must not touch; obstacles come behind the shafts."""
        radii = [*self.instruments.radii, *(o.radius for o in self.obstacles)]
        pairs = all_pairs(len(self.starts), len(self.obstacles))
        return Touch(pairs, np.array(radii))

    def capsules(self, tips: Array, time: float) -> Array:
        """Ends of all capsules (C, 2, 3) [mm] with tips at (I, 3) [mm]."""
        others = [o.at(time)[0] for o in self.obstacles]
        return np.concatenate([self.instruments.shafts(tips), np.reshape(others, (-1, 2, 3))])

    def motion(self, tips: Array, times: Array) -> Array:
        """Ends of all capsules (T, C, 2, 3) [mm] with tips (T, I, 3) at times (T,)."""
        others = [o.along(times) for o in self.obstacles]
        shafts = self.instruments.shafts(tips)
        return np.concatenate([shafts, *(o[:, None] for o in others)], axis=1)

    def clearance(self, tips: Array, times: Array) -> float:
        """Least clearance [mm] of a posture over times."""
        return self._clearance(np.broadcast_to(tips, (len(times), *tips.shape)), times)

    def _clearance(self, tips: Array, times: Array) -> float:
        touch, ends = self.touch(), self.motion(tips, times)
        one, two = ends[:, touch.pairs[:, 0]], ends[:, touch.pairs[:, 1]]
        gaps = segment_distances(one, two) - touch.radii[touch.pairs].sum(axis=1)
        return float(gaps.min(initial=1e6))

    def straight(self) -> float:
        """Least clearance [mm] where all tips go straight to their goals."""
        way = self.goals - self.starts
        length = np.linalg.norm(way, axis=1, keepdims=True)
        times = np.arange(0.0, float(length.max()) / BRISK + LOOKED, LOOKED)
        share = np.minimum(1.0, BRISK * times[:, None, None] / np.maximum(length, LOOKED))
        return self._clearance(self.starts + share * way, times)

    def passed(self, times: Array) -> float:
        """Least clearance [mm] of shafts anywhere on the straight way to obstacles at any time."""
        share = np.linspace(0.0, 1.0, WAY)[:, None, None]
        shafts = self.instruments.shafts(self.starts + share * (self.goals - self.starts))
        found = np.inf
        for obstacle in self.obstacles:
            along = obstacle.along(times)[None, :, None]
            if np.array_equal(*obstacle.ends):
                gaps = point_distances(along[..., 0, :], shafts[:, None])
            else:
                gaps = segment_distances(shafts[:, None], along)
            radii = self.instruments.radii + obstacle.radius
            found = min(found, float((gaps - radii).min()))
        return found

    def inside(self, tips: Array) -> bool:
        """Whether tips (I, 3) are at depths that are allowed, and not too steep."""
        below = tips - self.instruments.trocars
        depth = np.linalg.norm(below, axis=1)
        low = -below[:, 2] >= np.cos(np.radians(STEEP)) * depth
        return bool((low & (depth >= DEPTHS[0]) & (depth <= DEPTHS[1])).all())

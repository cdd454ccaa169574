r"""Made-up tasks for several instruments, each drawn from a seed; lengths in mm.

Every family is a way in which the straight way fails: shafts that cross, shafts that pass in
parallel, a gap hardly wider than a shaft, a wall between tip and goal, an obstacle that comes, and
three or four instruments that want each other's places. Starts and goals are drawn until both keep
a room of 4 mm to everything, by coal. Obstacles that move swing to and fro,

.. math:: O(t) = O_0 + A \sin(\omega t + \varphi)

and goals keep clear of the whole swing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from experiments.reality.instruments import Instruments, Mismatch
from experiments.reality.touch import Touch, all_pairs

Array = NDArray[np.float64]
ROOM = 4.0  # [mm] between any two capsules at start and goal
TRIES = 400
STATED = Mismatch(0.1, 0.03, gain=0.05, lag=0.006, delay=0.005, deadband=0.5)


@dataclass(frozen=True)
class Swing:
    """A capsule that moves to and fro, or stands still.

    Attributes:
        ends: Both ends at rest (2, 3) [mm]; the same twice for a sphere.
        radius: Its radius [mm].
        way: How far it swings (3,) [mm].
        rate: Angular rate [rad/s].
        phase: At time zero [rad].
    """

    ends: Array
    radius: float
    way: Array
    rate: float = 0.0
    phase: float = 0.0

    def at(self, time: float) -> tuple[Array, Array]:
        """Ends (2, 3) [mm] and velocity (3,) [mm/s]."""
        angle = self.rate * time + self.phase
        return self.ends + self.way * np.sin(angle), self.rate * self.way * np.cos(angle)


@dataclass(frozen=True)
class Scenario:
    """A task.

    Attributes:
        family: What kind.
        seed: What it was drawn from.
        instruments: Trocars, lengths, radii.
        starts: Tips at the start (I, 3) [mm].
        goals: Tips wanted (I, 3) [mm].
        obstacles: What is in the way.
        mismatch: How the plant differs from the model.
    """

    family: str
    seed: int
    instruments: Instruments
    starts: Array
    goals: Array
    obstacles: tuple[Swing, ...]
    mismatch: Mismatch

    def touch(self) -> Touch:
        """All pairs that must not touch; obstacles come behind the shafts."""
        radii = [*self.instruments.radii, *(o.radius for o in self.obstacles)]
        pairs = all_pairs(len(self.starts), len(self.obstacles))
        return Touch(pairs, np.array(radii))

    def capsules(self, tips: Array, time: float) -> Array:
        """Ends of all capsules (C, 2, 3) [mm] with tips at (I, 3) [mm]."""
        others = [o.at(time)[0] for o in self.obstacles]
        return np.concatenate([self.instruments.shafts(tips), np.reshape(others, (-1, 2, 3))])

    def room(self, tips: Array, times: Array) -> float:
        """Least clearance [mm] of a posture over times."""
        touch = self.touch()
        return min(float(touch.clearances(self.capsules(tips, t)).min(initial=1e6)) for t in times)


def _instruments(trocars: Array) -> Instruments:
    count = len(trocars)
    return Instruments(np.asarray(trocars, float), np.full(count, 250.0), np.full(count, 2.5))


def _swing(
    a: ArrayLike, b: ArrayLike, radius: float, way: Array | None = None, rate: float = 0.0
) -> Swing:
    still = np.zeros(3) if way is None else np.asarray(way, float)
    return Swing(np.array([a, b], dtype=float), radius, still, rate)


Draft = tuple[Array, Array, Array, tuple[Swing, ...]]


def crossing(rng: np.random.Generator) -> Draft:
    """Two tips swap sides, so that the shafts cross."""
    half = rng.uniform(30, 55)
    trocars = np.array([[-half, 0, 0], [half, 0, 0]]) + rng.normal(0, 4, (2, 3))
    far, depth = rng.uniform(20, 40), rng.uniform(95, 140)
    left = np.array([-far, 0, -depth]) + rng.normal(0, 5, 3)
    right = np.array([far, 0, -depth]) + rng.normal(0, 5, 3)
    ends = np.stack([left, right])
    others = ends[::-1] + rng.normal(0, 5, (2, 3))
    return trocars, ends, others, ()


def parallel(rng: np.random.Generator) -> Draft:
    """Two shafts side by side that sweep past each other, nearly parallel all the while."""
    half = rng.uniform(6, 9)
    trocars = np.array([[-half, 0, 0], [half, 0, 0]]) + np.array([0, 0, 1]) * rng.normal(0, 3)
    near, sweep = rng.uniform(-1, 3), rng.uniform(25, 40)
    depth = rng.uniform(100, 140) + np.array([0.0, rng.normal(0, 5)])
    starts = np.array([[-near, -sweep, -depth[0]], [near, sweep, -depth[1]]])
    goals = np.array([[-near, sweep, -depth[0]], [near, -sweep, -depth[1]]])
    return trocars, starts, goals + rng.normal(0, 2, (2, 3)), ()


def narrow_gap(rng: np.random.Generator) -> Draft:
    """One of two instruments passes between two rods hardly farther apart than its shaft."""
    trocars = np.array([[-45.0, 0, 0], [45.0, 0, 0]]) + rng.normal(0, 4, (2, 3))
    radius, gap = rng.uniform(3, 6), rng.uniform(12, 16)
    x = rng.uniform(-15, 0)
    rods = []
    for side in (-1.0, 1.0):
        y = side * (gap / 2 + radius)
        rods.append(_swing([x, y, -170], [x, y + side * 6, -60], radius))
    starts = np.array([[x - 35, 0, -110], [50, rng.uniform(-20, 20), -110]])
    goals = np.array([[x + 25, 0, -110], [65, rng.uniform(-20, 20), -120]])
    return trocars, starts + rng.normal(0, 4, (2, 3)), goals + rng.normal(0, 4, (2, 3)), tuple(rods)


def dead_end(rng: np.random.Generator) -> Draft:
    """A wall of rods between tip and goal: the straight way ends in a pocket."""
    trocars = np.array([[-45.0, 0, 0], [45.0, 0, 0]]) + rng.normal(0, 4, (2, 3))
    width, radius = rng.uniform(14, 24), 4.0
    depth = rng.uniform(100, 125)
    x = rng.uniform(-12, -4)
    wall = _swing([x, -width, -depth], [x, width, -depth], radius)
    arms = [
        _swing([x, side * width, -depth], [x - rng.uniform(10, 20), side * width, -depth], radius)
        for side in (-1.0, 1.0)
    ]
    starts = np.array([[x - 35, 0, -depth - 8], [50, rng.uniform(-20, 20), -110]])
    goals = np.array([[x + 22, 0, -depth - 8], [62, rng.uniform(-20, 20), -120]])
    noise = rng.normal(0, 4, (2, 2, 3))
    return trocars, starts + noise[0], goals + noise[1], (wall, *arms)


def moving_obstacle(rng: np.random.Generator) -> Draft:
    """A sphere or a rod swings across the way of two instruments."""
    trocars = np.array([[-45.0, 0, 0], [45.0, 0, 0]]) + rng.normal(0, 4, (2, 3))
    obstacles = []
    for _ in range(int(rng.integers(1, 4))):
        middle = np.array([rng.uniform(-25, 25), rng.uniform(-15, 15), rng.uniform(-150, -90)])
        along = rng.normal(size=3) * rng.uniform(0, 12) * (rng.random() < 0.5)
        way = rng.normal(size=3) * np.array([8, 12, 8])
        speed = rng.uniform(5.0, 20.0)  # [mm/s], at the middle of the swing
        rate = min(speed / max(float(np.linalg.norm(way)), 1.0), 1.5)
        radius = rng.uniform(3, 7)
        swing = _swing(middle - along, middle + along, radius, way, rate)
        obstacles.append(replace(swing, phase=rng.uniform(0, 2 * np.pi)))
    starts = np.array([[-35.0, 0, -115], [35.0, 0, -115]]) + rng.normal(0, 10, (2, 3))
    goals = np.array([[5.0, 0, -115], [45.0, 0, -115]]) + rng.normal(0, 15, (2, 3))
    return trocars, starts, goals, tuple(obstacles)


def _ring(rng: np.random.Generator, count: int) -> Draft:
    angles = 2 * np.pi * np.arange(count) / count + rng.uniform(0, 2 * np.pi)
    angles = angles + rng.normal(0, 0.1, count)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
    trocars = rng.uniform(50, 65) * ring
    depth = np.array([0, 0, -1]) * rng.uniform(95, 135, (count, 1))
    starts = rng.uniform(18, 35) * ring + depth + rng.normal(0, 5, (count, 3))
    turn = rng.permutation(count)
    goals = rng.uniform(18, 35) * ring[turn] + depth[turn] + rng.normal(0, 5, (count, 3))
    return trocars, starts, goals, ()


def three(rng: np.random.Generator) -> Draft:
    """Three instruments, places exchanged."""
    return _ring(rng, 3)


def four(rng: np.random.Generator) -> Draft:
    """Four instruments, places exchanged."""
    return _ring(rng, 4)


FAMILIES = {
    "crossing": crossing,
    "parallel": parallel,
    "narrow gap": narrow_gap,
    "dead end": dead_end,
    "moving obstacle": moving_obstacle,
    "three instruments": three,
    "four instruments": four,
}


def draw(family: str, seed: int, mismatch: Mismatch = STATED) -> Scenario:
    """A task of a family.

    Raises:
        KeyError: No such family; see :data:`FAMILIES`.
        RuntimeError: No start and goal with room found in 400 tries.
    """
    make = FAMILIES[family]
    rng = np.random.default_rng([seed, sorted(FAMILIES).index(family)])
    times = np.linspace(0.0, 20.0, 41)
    for _ in range(TRIES):
        trocars, starts, goals, obstacles = make(rng)
        found = Scenario(family, seed, _instruments(trocars), starts, goals, obstacles, mismatch)
        moving = any(o.rate for o in obstacles)
        if found.room(starts, times[:1]) < ROOM:
            continue
        if found.room(goals, times if moving else times[:1]) >= ROOM:
            return found
    raise RuntimeError(f"{family}, seed {seed}: no start and goal with {ROOM} mm of room")

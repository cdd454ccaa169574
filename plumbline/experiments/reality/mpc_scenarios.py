r"""Made-up tasks for several instruments, each drawn from a seed; lengths in mm.

Every family is a way in which the straight way fails: shafts that cross, shafts that pass in
parallel, a gap hardly wider than a shaft, a wall between tip and goal, obstacles that come, slowly
or at up to a metre a second, tips hardly behind their trocars, whose outer ends then move up to
sixteen times as fast, and three or four instruments that want each other's places. Tips lie
anywhere between the least and the most depth, below the plane of their trocar. Starts and goals are
drawn until both keep 4 mm clear to everything, and the straight way between them does not keep
2. Goals keep clear of an obstacle's whole way, and starts where it is not slow: who waits is safe.
One that is faster than any tip cannot be evaded by whoever sees it late, so its whole way keeps
clear of the straight way of the shafts too: it may pass as near as anything else.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.instruments import Instruments, Mismatch
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.task import BRISK, DEPTHS, LOOKED, Scenario, Swing

RANGES = Ranges("needles")
CLEAR = 4.0  # [mm] between any two capsules at start and goal
TRIES = 4000  # starts and goals that are drawn until a task is clear
BLOCKED = 2.0  # [mm] that the straight way comes short of
EVADED = 20.0  # [mm/s] of an obstacle, up to which a shaft may start in its way
SLOW = (5.0, EVADED)  # [mm/s] of what swings and can be evaded
DRIFTS = (20.0, BRISK)  # [mm/s] of what drifts, no faster than a tip
HARDLY, WELL = (DEPTHS[0], 30.0), (60.0, DEPTHS[1])  # [mm] behind a trocar
PASSED = 6.0  # [s] after which an obstacle that drifts has left, or a swing repeats itself
STATED = Mismatch(0.1, 0.03, gain=0.05, lag=0.006, delay=0.005, deadband=0.5)


def _instruments(trocars: Array) -> Instruments:
    count = len(trocars)
    return Instruments(np.asarray(trocars, float), np.full(count, 250.0), np.full(count, 2.5))


def _swing(
    a: ArrayLike, b: ArrayLike, radius: float, way: Array | None = None, rate: float = 0.0
) -> Swing:
    still = np.zeros(3) if way is None else np.asarray(way, float)
    return Swing(np.array([a, b], dtype=float), radius, still, rate)


def _apart(rng: np.random.Generator, half: float = 45.0) -> Array:
    """Two trocars (2, 3) on either side."""
    return np.array([[-half, 0, 0], [half, 0, 0]]) + RANGES.near("trocar", rng, (2, 3))


def _beside(rng: np.random.Generator, half: float) -> Array:
    """Two trocars (2, 3) that are close, and as high."""
    up = float(RANGES.near("height", rng))
    return np.array([[-half, 0, up], [half, 0, up]])


def _circle(angles: Array) -> Array:
    """Places (I, 3) on a circle of radius one."""
    return np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)


Draft = tuple[Array, Array, Array, tuple[Swing, ...]]


def _at_depths(rng: np.random.Generator, draft: Draft) -> Draft:
    """The same shafts, with every tip somewhere else along its shaft."""
    trocars, starts, goals, obstacles = draft

    def along(tips: Array) -> Array:
        way = tips - trocars
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        return trocars + rng.uniform(*DEPTHS, (len(tips), 1)) * way

    return trocars, along(starts), along(goals), obstacles


def scaled(rng: np.random.Generator, make: Callable[[np.random.Generator, float], Draft]) -> Draft:
    """A scene nearer to its trocars or farther from them; what is narrow stays as narrow."""
    scale = RANGES.one("scale", rng)
    trocars, starts, goals, obstacles = make(rng, scale)
    placed = tuple(replace(o, ends=scale * o.ends, way=scale * o.way) for o in obstacles)
    return scale * trocars, scale * starts, scale * goals, placed


def crossing(rng: np.random.Generator) -> Draft:
    """Two tips swap sides, so that the shafts cross."""
    half = RANGES.one("half", rng)
    trocars = _apart(rng, half)
    far, depth = RANGES.one("far", rng), RANGES.one("deep", rng)
    ends = np.array([[-far, 0, -depth], [far, 0, -depth]]) + RANGES.near("tip", rng, (2, 3))
    others = ends[::-1] + RANGES.near("tip", rng, (2, 3))
    return _at_depths(rng, (trocars, ends, others, ()))


def parallel(rng: np.random.Generator) -> Draft:
    """Two shafts side by side that sweep past each other, nearly parallel all the while."""
    half = RANGES.one("close", rng)
    trocars = _beside(rng, half)
    near, sweep = RANGES.one("near", rng), RANGES.one("sweep", rng)
    depth = RANGES.one("pass_depth", rng) + np.array([0.0, float(RANGES.near("tip", rng))])
    starts = np.array([[-near, -sweep, -depth[0]], [near, sweep, -depth[1]]])
    goals = np.array([[-near, sweep, -depth[0]], [near, -sweep, -depth[1]]])
    return _at_depths(rng, (trocars, starts, goals + RANGES.near("passed", rng, (2, 3)), ()))


def narrow_gap(rng: np.random.Generator, scale: float) -> Draft:
    """One of two instruments passes between two rods hardly farther apart than its shaft."""
    trocars = _apart(rng)
    radius, gap, x = (RANGES.one(name, rng) for name in ("rod", "gap", "gap_at"))
    rods = []
    for side in (-1.0, 1.0):
        y = side * (gap / 2 + radius) / scale
        rods.append(_swing([x, y, -170], [x, y + side * 6, -60], radius))
    starts = np.array([[x - 35, 0, -110], [50, RANGES.one("off", rng), -110]])
    goals = np.array([[x + 25, 0, -110], [65, RANGES.one("off", rng), -120]])
    noise = RANGES.near("narrow", rng, (2, 2, 3))
    return trocars, starts + noise[0], goals + noise[1], tuple(rods)


def dead_end(rng: np.random.Generator, _: float) -> Draft:
    """A wall of rods between tip and goal: the straight way ends in a pocket."""
    trocars = _apart(rng)
    width, depth, x = (RANGES.one(name, rng) for name in ("width", "wall_depth", "wall_at"))
    radius = 4.0
    wall = _swing([x, -width, -depth], [x, width, -depth], radius)
    arms = [
        _swing([x, y, -depth], [x - RANGES.one("pocket", rng), y, -depth], radius)
        for y in (-width, width)
    ]
    starts = np.array([[x - 35, 0, -depth - 8], [50, RANGES.one("off", rng), -110]])
    goals = np.array([[x + 22, 0, -depth - 8], [62, RANGES.one("off", rng), -120]])
    noise = RANGES.near("narrow", rng, (2, 2, 3))
    return trocars, starts + noise[0], goals + noise[1], (wall, *arms)


def moving_obstacle(rng: np.random.Generator, scale: float) -> Draft:
    """Spheres or rods swing across the way of two instruments."""
    trocars = _apart(rng)
    obstacles = []
    for _ in range(RANGES.whole("swings", rng)):
        middle = np.array([RANGES.one(axis, rng) for axis in ("across", "along", "height")])
        along = rng.normal(size=3) * RANGES.one("rod_half", rng) * RANGES.happens("rod", rng)
        way = RANGES.near("swing", rng, 3)
        speed = rng.uniform(*SLOW)  # at the middle of the swing
        rate = min(speed / max(scale * float(np.linalg.norm(way)), 1.0), 1.5)
        radius = RANGES.one("body", rng)
        swing = _swing(middle - along, middle + along, radius, way, rate)
        obstacles.append(replace(swing, phase=rng.uniform(0, 2 * np.pi)))
    starts = np.array([[-35.0, 0, -115], [35.0, 0, -115]]) + RANGES.near("start", rng, (2, 3))
    goals = np.array([[5.0, 0, -115], [45.0, 0, -115]]) + RANGES.near("goal", rng, (2, 3))
    return trocars, starts, goals, tuple(obstacles)


def ring(rng: np.random.Generator, count: int) -> Draft:
    """So many instruments about a ring, places exchanged."""
    angles = 2 * np.pi * np.arange(count) / count + rng.uniform(0, 2 * np.pi)
    angles = angles + RANGES.near("spacing", rng, count)
    circle = _circle(angles)
    trocars = RANGES.one("circle", rng) * circle
    depth = np.array([0, 0, -1]) * RANGES.many("ring_depth", rng, (count, 1))
    starts = RANGES.one("inner", rng) * circle + depth + RANGES.near("tip", rng, (count, 3))
    turn = rng.permutation(count)
    inner = RANGES.one("inner", rng)
    goals = inner * circle[turn] + depth[turn] + RANGES.near("tip", rng, (count, 3))
    return _at_depths(rng, (trocars, starts, goals, ()))


def _anywhere(rng: np.random.Generator, trocars: Array, depths: tuple[float, float]) -> Array:
    """Tips (I, 3) anywhere behind their trocars."""
    way = rng.normal(size=(len(trocars), 3))
    way[:, 2] = -np.abs(way[:, 2])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return trocars + rng.uniform(*depths, (len(trocars), 1)) * way


def shallow(rng: np.random.Generator) -> Draft:
    """Tips hardly behind trocars that are close: outer ends sweep far, and fast."""
    half = RANGES.one("shallow", rng)
    trocars = _beside(rng, half)
    starts, goals = (_anywhere(rng, trocars, HARDLY) for _ in range(2))
    return trocars, starts, goals, ()


def _flier(rng: np.random.Generator, aim: Array, when: float) -> Swing:
    """A sphere or a rod that flies straight through a point at a time, at up to 1 m/s."""
    way = rng.normal(size=3)
    drift = RANGES.one("fast", rng) * way / np.linalg.norm(way)
    half = rng.normal(size=3) * RANGES.one("flier_half", rng) * RANGES.happens("rod", rng)
    middle, velocity = aim - when * drift, (float(drift[0]), float(drift[1]), float(drift[2]))
    flier = _swing(middle - half, middle + half, RANGES.one("flier", rng))
    return replace(flier, drift=velocity)


def _swinger(rng: np.random.Generator, middle: Array) -> Swing:
    way = rng.normal(size=3)
    way *= RANGES.one("swing", rng) / np.linalg.norm(way)
    speed = RANGES.one("fast", rng)
    swing = _swing(
        middle, middle, RANGES.one("flier", rng), way, speed / float(np.linalg.norm(way))
    )
    return replace(swing, phase=rng.uniform(0, 2 * np.pi))


def fast_obstacle(rng: np.random.Generator) -> Draft:
    """One or two obstacles that fly past or swing at up to a metre a second."""
    trocars = _apart(rng)
    starts, goals = _crossed(rng, trocars)
    return trocars, starts, goals, _fast(rng, trocars, starts, goals, RANGES.whole("fliers", rng))


def _alone(trocars: Array, starts: Array, goals: Array) -> Scenario:
    return Scenario("", 0, _instruments(trocars), starts, goals, (), STATED)


def _crossed(rng: np.random.Generator, trocars: Array) -> tuple[Array, Array]:
    """Starts and goals anywhere, such that the shafts are in each other's way."""
    for _ in range(TRIES):
        starts, goals = (_anywhere(rng, trocars, DEPTHS) for _ in range(2))
        own = _alone(trocars, starts, goals)
        if own.inside(starts) and own.inside(goals) and own.straight() < BLOCKED:
            break
    return starts, goals


def _fast(
    rng: np.random.Generator, trocars: Array, starts: Array, goals: Array, count: int
) -> tuple[Swing, ...]:
    """So many fast obstacles about the tips' ways, as near as they may be."""
    found: list[Swing] = []
    own = _alone(trocars, starts, goals)
    for _ in range(TRIES):
        i, share = int(rng.integers(len(trocars))), rng.uniform()
        near = starts[i] + share * (goals[i] - starts[i]) + RANGES.near("near", rng, 3)
        flies = RANGES.happens("flies", rng)
        tried = _flier(rng, near, RANGES.one("when", rng)) if flies else _swinger(rng, near)
        if replace(own, obstacles=(tried,)).passed(np.arange(0.0, PASSED, 4 * LOOKED)) >= CLEAR:
            found.append(tried)
        if len(found) == count:
            break
    return tuple(found)


def drifting_obstacle(rng: np.random.Generator) -> Draft:
    """Obstacles drift straight across the tips' ways, no faster than a tip."""
    trocars = _apart(rng)
    starts, goals = (_anywhere(rng, trocars, WELL) for _ in range(2))
    found = []
    for _ in range(RANGES.whole("drifters", rng)):
        i, share = int(rng.integers(2)), rng.uniform()
        near = starts[i] + share * (goals[i] - starts[i]) + RANGES.near("met", rng, 3)
        when, way = share * np.linalg.norm(goals[i] - starts[i]) / BRISK, rng.normal(size=3)
        drift = rng.uniform(*DRIFTS) * way / np.linalg.norm(way)
        middle, half = near - when * drift, RANGES.near("rod", rng, 3)
        flier = _swing(middle - half, middle + half, 5.0)
        velocity = (float(drift[0]), float(drift[1]), float(drift[2]))
        found.append(replace(flier, radius=RANGES.one("drifter", rng), drift=velocity))
    return trocars, starts, goals, tuple(found)


def crowd(rng: np.random.Generator) -> Draft:
    """Two to four instruments at any depth among obstacles that stand, swing and fly past."""
    count = RANGES.whole("crowd", rng)
    angles = 2 * np.pi * np.arange(count) / count + RANGES.near("spacing", rng, count)
    circle = _circle(angles)
    trocars = RANGES.one("crowd_circle", rng) * circle
    starts, goals = _crossed(rng, trocars)
    still = []
    for _ in range(RANGES.whole("still", rng)):
        at, half = RANGES.near("place", rng, 3) - [0.0, 0.0, 110.0], RANGES.near("rod", rng, 3)
        still.append(_swing(at - half, at + half, RANGES.one("still_body", rng)))
    return trocars, starts, goals, (*still, *_fast(rng, trocars, starts, goals, 1))


FAMILIES: dict[str, Callable[[np.random.Generator], Draft]] = {
    "crossing": crossing,
    "parallel": parallel,
    "narrow gap": partial(scaled, make=narrow_gap),
    "dead end": partial(scaled, make=dead_end),
    "moving obstacle": partial(scaled, make=moving_obstacle),
    "three instruments": partial(ring, count=3),
    "four instruments": partial(ring, count=4),
    "shallow": shallow,
    "fast obstacle": fast_obstacle,
    "crowd": crowd,
}
# Obstacles as fast as a tip come across the way: a shaft moves slower than its tip, so nobody can
# evade all of them, and contacts are counted, not excluded.
PRESSED: dict[str, Callable[[np.random.Generator], Draft]] = {
    "drifting obstacle": drifting_obstacle
}


def draw(family: str, seed: int, mismatch: Mismatch = STATED) -> Scenario:
    """A task of :data:`FAMILIES` or :data:`PRESSED` (RuntimeError: none is clear in 4000 tries)."""
    make = (FAMILIES | PRESSED)[family]
    rng = np.random.default_rng([seed, crc32(family.encode())])
    for _ in range(TRIES):
        trocars, starts, goals, obstacles = make(rng)
        found = Scenario(family, seed, _instruments(trocars), starts, goals, obstacles, mismatch)
        inside = found.inside(starts) and found.inside(goals)
        if inside and found.straight() < BLOCKED and _is_clear(found):
            return found
    raise RuntimeError(f"{family}, seed {seed}: no start and goal that are {CLEAR} mm clear")


def _is_clear(found: Scenario) -> bool:
    now, always = np.zeros(1), np.arange(0.0, PASSED, LOOKED)
    if min(found.clearance(found.starts, now), found.clearance(found.goals, now)) < CLEAR:
        return False
    speed = max((o.speed for o in found.obstacles), default=0.0)
    waits = speed <= EVADED or found.clearance(found.starts, always) >= CLEAR
    evaded = speed <= BRISK or found.passed(always) >= CLEAR
    return waits and evaded and (speed == 0.0 or found.clearance(found.goals, always) >= CLEAR)

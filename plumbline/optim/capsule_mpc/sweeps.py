r"""Where obstacles faster than a tip can be: still capsules, which who is outside can stay out of.

A tip has bounded speed and acceleration, so it comes out of the way of what is faster only if it
knows of it beforehand. Two things are known. What has been seen to turn back turns back again: an
obstacle whose way is longer than its extent,

.. math:: \sum_k |c_k - c_{k-1}| > |c_p - c_q| + \epsilon, \qquad
          |c_p - c_q| = \max_{k, l}|c_k - c_l|

is replaced by the capsule about all places c at which it was,

.. math:: \big[c_p, c_q\big], \qquad r + \max_k d\big(c_k, [c_p, c_q]\big)

Until it was seen to go all of its way there and back, where it will turn is foreseen: to first
order what swings is on a spring, and its speed v at the places s of a line is

.. math:: v^2 = \omega^2 \big(A^2 - (s - s_0)^2\big)

so three looks say where v is zero. And what does neither goes straight on, as long as it last did:
it is replaced by the capsule about its way until then. All of these stand still. The stop at hand
keeps clear of what stands still (:mod:`.controller`), so who is outside stays outside at any speed
of the obstacle; who is inside when they become known is pushed out the shortest way, across their
axis and not along it, and is told where to by :mod:`.evasion`. Between two looks an obstacle is on
the cubic that has its places and velocities at both (Hermite), so no turning point is missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.capsule_mpc.bodies import Point
from plumbline.optim.capsule_mpc.scene import STILL, Obstacle

Array = NDArray[np.float64]
AHEAD = 1.2  # [s] that obstacles are foreseen: shafts hit by ones at 60 mm/s could be saved 1.0 s
# before, by some constant rate, and 0.8 s before no more
STRAIGHT = 1.0  # [mm] by which an obstacle may be beside its way and still go straight on
TURNED = 1.0  # [mm] by which a way is longer than its extent where it has turned
CHANGED = 0.1  # of its squared speed, of which a spring is to be seen
RECENT = 25  # looks that show it
MEMORY = 10.0  # [s] that places are remembered: a period of 60 mm at 38 mm/s
CUBIC = np.arange(1, 6) / 5  # of a step, where its cubic is looked at
HERMITE = np.stack(
    [
        2 * CUBIC**3 - 3 * CUBIC**2 + 1,
        CUBIC**3 - 2 * CUBIC**2 + CUBIC,
        3 * CUBIC**2 - 2 * CUBIC**3,
        CUBIC**3 - CUBIC**2,
    ],
    axis=1,
)


class Sweeps:
    """Remembers how obstacles moved."""

    def __init__(self, dt: float, speed: float) -> None:
        """For looks every dt [s], and tips that move so fast at most [mm/s]."""
        self._dt, self._speed = dt, speed
        self._most = int(MEMORY / dt) * len(CUBIC)
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self._looks = np.zeros((0, 2, 0, 3))  # middles, and steps at the present rate
        self._places = np.zeros((0, 0, 3))
        self._way = self._peak = np.zeros(0)
        self._begun = np.zeros((0, 7))  # where a straight way began, its rate, how long
        self.straight = np.zeros(0)  # how far ahead (K,) each is believed to go straight on [s]

    def swept(self, obstacles: Sequence[Obstacle]) -> list[Obstacle]:
        """The obstacles as seen a step later; fast ones that have turned by what they sweep."""
        found = list(obstacles)
        if not found:
            return found
        table = np.array([(*o.a, *o.b, *o.velocity) for o in found])
        self._watch(table)
        self._remember(table)
        for k in np.flatnonzero(self._peak > 0.0).tolist():
            found[k] = self._about_all(k, found[k])
        return found

    def ahead(self, obstacles: Sequence[Obstacle]) -> list[Obstacle]:
        """Of these as well, fast ones that move by their way ahead."""
        found = list(obstacles)
        for k, obstacle in enumerate(found):
            rate = np.array(obstacle.velocity)
            if rate @ rate > self._speed**2:
                middle = (np.array(obstacle.a) + obstacle.b) / 2
                found[k] = about(obstacle, middle, middle + self.straight[k] * rate)
        return found

    def _watch(self, table: Array) -> None:
        """How long every obstacle goes straight on."""
        now = np.column_stack([table[:, [0, 1, 2, 6, 7, 8]], np.zeros(len(table))])
        if len(self._begun) != len(table):
            self._begun, self.straight = now, np.full(len(table), AHEAD)
            return
        place, rate, gone = self._begun[:, :3], self._begun[:, 3:6], self._begun[:, 6] + self._dt
        off = place + gone[:, None] * rate - table[:, :3]
        bent = np.vecdot(off, off) > STRAIGHT**2
        seen = np.minimum(gone, AHEAD)
        self.straight = np.where(bent, seen, np.maximum(self.straight, seen))
        self._begun[:, 6] = gone
        self._begun[bent] = now[bent]

    def _remember(self, table: Array) -> None:
        """Where they were, on the way too, how far they went, and how fast at most."""
        now = np.stack([(table[:, :3] + table[:, 3:6]) / 2, self._dt * table[:, 6:9]])
        if self._looks.shape[1:] != now.shape:
            self._looks, self._places = now[None], now[:1]
            self._way = self._peak = np.zeros(len(table))
        else:
            fresh = np.einsum("pi,ikx->pkx", HERMITE, np.concatenate([self._looks[-1], now]))
            steps = np.diff(np.concatenate([self._places[-1:], fresh]), axis=0)
            self._way = self._way + np.sqrt(np.vecdot(steps, steps)).sum(axis=0)
            self._places = np.concatenate([self._places, fresh])[-self._most :]
            self._looks = np.concatenate([self._looks, now[None]])[-RECENT:]
        self._peak = np.maximum(self._peak, np.sqrt(np.vecdot(now[1], now[1])) / self._dt)

    def _about_all(self, k: int, obstacle: Obstacle) -> Obstacle:
        """The capsule about all that a fast one sweeps, if that is known."""
        places = self._places[:, k]
        p, q, extent = _extremes(places)
        turned = self._way[k] >= extent + TURNED
        if self._way[k] < 2 * extent + TURNED:
            peak, ends = _spring(*np.moveaxis(self._looks[:, :, k], 1, 0))
            self._peak[k] = max(self._peak[k], peak / self._dt)
            places, turned = np.concatenate([places, ends]), turned or bool(len(ends))
            p, q, extent = _extremes(places)
        if not turned or self._peak[k] <= self._speed:
            return obstacle
        share = np.clip((places - p) @ (q - p) / max(extent**2, 1e-12), 0.0, 1.0)
        off = places - p - share[:, None] * (q - p)
        return about(obstacle, p, q, float(np.sqrt(np.vecdot(off, off).max())))


def _extremes(places: Array) -> tuple[Array, Array, float]:
    """Two of the places (N, 3) that are farthest apart, on or near a line, and how far that is."""
    p = places[_farthest(places, places[-1])]
    q = places[_farthest(places, p)]
    return p, q, float(np.linalg.norm(q - p))


def _spring(places: Array, steps: Array) -> tuple[float, Array]:
    """Largest step, and turning points (2, 3), of what was at places (T, 3) with such steps.

    Nothing (0, 3) where it does not swing along a line, or this is not to be seen yet.
    """
    squares, none = np.vecdot(steps, steps), np.zeros((0, 3))
    most = float(squares.max())
    if most - squares.min() < CHANGED * most:
        return 0.0, none
    along = steps[int(squares.argmax())] / np.sqrt(most)
    s = (places - places[-1]) @ along
    off = places - places[-1] - s[:, None] * along
    if len(s) < 3 or np.vecdot(off, off).max() > STRAIGHT**2:
        return 0.0, none
    a, b, c = np.polyfit(s, squares, 2)
    peak = c - b * b / (4 * a) if a < 0.0 else 0.0
    if peak <= 0.0:
        return 0.0, none
    half = np.sqrt(-peak / a)
    ends = -b / (2 * a) + half * np.array([-1.0, 1.0])
    return float(np.sqrt(peak)), places[-1] + ends[:, None] * along


def about(obstacle: Obstacle, first: Array, last: Array, wide: float = 0.0) -> Obstacle:
    """The still capsule about an obstacle with its middle anywhere between two points (3,).

    What it sweeps is a parallelogram with rounded corners: the longer of way and rod is the axis,
    what of the other points along it makes it longer, the rest wider.
    """
    way, rod = (last - first) / 2, (np.array(obstacle.b) - obstacle.a) / 2
    long, short = (way, rod) if way @ way >= rod @ rod else (rod, way)
    along = long / max(float(np.linalg.norm(long)), 1e-12)
    half = long + abs(float(short @ along)) * along
    wide += float(np.linalg.norm(short - (short @ along) * along))
    middle = (first + last) / 2
    return replace(
        obstacle,
        a=point(middle - half),
        b=point(middle + half),
        radius=obstacle.radius + wide,
        velocity=STILL,
    )


def _farthest(places: Array, one: Array) -> int:
    off = places - one
    return int(np.vecdot(off, off).argmax())


def point(values: Array) -> Point:
    """Three plain numbers."""
    x, y, z = (float(v) for v in values)
    return x, y, z

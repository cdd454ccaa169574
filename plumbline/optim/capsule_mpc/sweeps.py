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

so three looks say where v is zero. These stand still. The stop at hand keeps clear of what stands
still (:mod:`.controller`), so who is outside stays outside at any speed of the obstacle; who is
inside when they become known is pushed out the shortest way. Between two looks an obstacle is on
the cubic that has its places and velocities at both (Hermite), so no turning point is missed.

What does neither goes straight on, as long as it last did. Who stands in its way is told where to
by :mod:`.evasion`, and is held up by nothing: to be within a way is not to be near an obstacle.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plumbline.kinematics.constants import TINY
from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.bodies import EndsInstrument, Obstacle, TipInstrument
from plumbline.optim.capsule_mpc.settings import Point
from plumbline.optim.capsule_mpc.statement import Statement
from plumbline.optim.core.problem import Array

CUBIC = np.arange(1, 6) / 5  # of a step, where its cubic is looked at
EPS = float(np.finfo(float).eps)
HERMITE = np.stack(
    [
        2 * CUBIC**3 - 3 * CUBIC**2 + 1,
        CUBIC**3 - 2 * CUBIC**2 + CUBIC,
        3 * CUBIC**2 - 2 * CUBIC**3,
        CUBIC**3 - CUBIC**2,
    ],
    axis=1,
)


def tip_speed(statement: Statement) -> float:
    """Largest speed of a tip [mm/s]; of arms, whose joints are bounded, none is known."""
    bodies = statement.bodies
    if not all(isinstance(body, TipInstrument | EndsInstrument) for body in bodies):
        return np.inf
    return float(statement.speed.max())


class Sweeps:
    """Remembers how obstacles moved."""

    def __init__(self, dt: float, speed: float) -> None:
        """For looks every dt [s], and tips that move so fast at most [mm/s]."""
        self._dt, self._speed = dt, speed
        self._most = int(constants.MEMORY / dt)
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self._looks = np.zeros((0, 2, 0, 3))  # middles, and steps at the present rate
        self._places, self._gone = np.zeros((0, 0, 3)), np.zeros((0, 0))  # and how far it went
        self._whole: dict[int, tuple[int, Array, Array, float]] = {}  # capsules of whole swings
        self._begun = np.zeros((0, 7))  # where a straight way began, its rate, how long
        self.straight = np.zeros(0)  # how far ahead (K,) each is believed to go straight on [s]

    def swept(self, obstacles: Sequence[Obstacle]) -> list[Obstacle]:
        """The obstacles as seen a step later; fast ones that have turned by what they sweep."""
        found = list(obstacles)
        if not found:
            return found
        table = np.array([(*o.a, *o.b, *o.velocity) for o in found])
        self._watch(table)
        fast = (np.vecdot(table[:, 6:], table[:, 6:]) > self._speed**2).any()
        if not fast and not len(self._looks):
            return found
        self._remember(table)
        steps = self._looks[:, 1]
        peak = np.sqrt(np.vecdot(steps, steps).max(axis=0)) / self._dt
        for k in np.flatnonzero(peak > self._speed).tolist():
            capsule = self._about_all(k)
            found[k] = about(found[k], *capsule) if capsule else found[k]
        return found

    def _watch(self, table: Array) -> None:
        """How long every obstacle goes straight on."""
        now = np.column_stack([table[:, [0, 1, 2, 6, 7, 8]], np.zeros(len(table))])
        if len(self._begun) != len(table):
            self._begun, self.straight = now, np.full(len(table), constants.AHEAD)
            return
        place, rate, gone = self._begun[:, :3], self._begun[:, 3:6], self._begun[:, 6] + self._dt
        off = place + gone[:, None] * rate - table[:, :3]
        bent = np.vecdot(off, off) > constants.STRAIGHT**2
        seen = np.minimum(gone, constants.AHEAD)
        self.straight = np.where(bent, seen, np.maximum(self.straight, seen))
        self._begun[:, 6] = gone
        self._begun[bent] = now[bent]

    def _remember(self, table: Array) -> None:
        """Where they were, on the way too, and how far they went."""
        now = np.stack([(table[:, :3] + table[:, 3:6]) / 2, self._dt * table[:, 6:9]])
        if self._looks.shape[1:] != now.shape:
            self._looks, self._places, self._gone = now[None], now[:1], np.zeros((1, len(table)))
            self._whole = {}
            return
        fresh = np.einsum("pi,ikx->pkx", HERMITE, np.concatenate([self._looks[-1], now]))
        ways = np.diff(np.concatenate([self._places[-1:], fresh]), axis=0)
        gone = self._gone[-1] + np.cumsum(np.sqrt(np.vecdot(ways, ways)), axis=0)
        self._looks = np.concatenate([self._looks, now[None]])[-self._most :]
        self._places = np.concatenate([self._places, fresh])[-self._most * len(CUBIC) :]
        self._gone = np.concatenate([self._gone, gone])[-self._most * len(CUBIC) :]

    def _about_all(self, k: int) -> tuple[Array, Array, float] | None:
        """Axis and radius of the capsule about a middle's sweep, if it has turned."""
        places, way = self._places[:, k], float(self._gone[-1, k] - self._gone[0, k])
        if k in self._whole:
            look, p, q, wide = self._whole[k]
            if look < constants.RECENT_LOOKS and _beside(places[-len(CUBIC) :], p, q) <= wide:
                self._whole[k] = (look + 1, p, q, wide)
                return p, q, wide
        p, q = _extremes(places)
        extent = float(np.linalg.norm(q - p))
        turned, whole = way >= extent + constants.TURNED, way >= 2 * extent + constants.TURNED
        if not whole:
            recent = self._looks[-constants.RECENT_LOOKS :, :, k]
            ends = _spring(recent[:, 0], recent[:, 1], self._most)
            turned = turned or bool(len(ends))
            if not len(ends):  # it goes on, whatever it has swept
                middle, step = recent[-1]
                ends = (middle + self.straight[k] / self._dt * step)[None]
            places = np.concatenate([places, ends])
            p, q = _extremes(places)
        if not turned:
            return None
        wide = _beside(places, p, q)
        if whole:
            self._whole[k] = (0, p, q, wide)
        return p, q, wide


class Looks:
    r"""What obstacles' places say of how they move, where that is stated otherwise.

    Over n looks the middle c of an obstacle goes by what its velocities v say, or beside it by

    .. math:: e = \sum_k (c_k - c_{k-1}) - dt\, (v_{k-1} + v_k) / 2

    If that is more than is seen of a straight way, and no small part of the way, its velocity is
    taken for :math:`v + e / (n\, dt)`. What is farther off than anything moves in a step is new.
    """

    def __init__(self, dt: float) -> None:
        """For looks every dt [s]."""
        self._dt = dt
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self._last = np.zeros((0, 6))  # middles, and half a step by their velocities
        self._gone = np.zeros((0, 0, 4))  # of each step what it is beside its velocity, and its way

    def believed(self, obstacles: Sequence[Obstacle]) -> tuple[list[Obstacle], list[int]]:
        """The obstacles as seen a step later, and whose velocities are not as stated."""
        found = list(obstacles)
        table = np.array([(*o.a, *o.b, *o.velocity) for o in found]).reshape(-1, 9)
        table[~np.isfinite(table)] = np.nan
        half = self._dt / 2 * table[:, 6:]
        now = np.concatenate([(table[:, :3] + table[:, 3:6]) / 2, half], axis=1)
        last, self._last = self._last, now
        if len(last) != len(now):
            self._gone = np.zeros((0, len(now), 4))
            return found, []
        step = now[:, :3] - last[:, :3]
        off = step - last[:, 3:] - half
        fresh = np.concatenate([off, np.sqrt(np.vecdot(step, step))[:, None]], axis=1)
        self._gone = np.concatenate([self._gone, fresh[None]])[-constants.FEWEST_LOOKS :]
        unknown = ~(np.vecdot(off, off) < (constants.FASTEST * self._dt) ** 2)  # NaN is not below
        self._gone[:, unknown] = 0.0
        gone = self._gone.sum(axis=0)
        most = np.maximum(constants.STRAIGHT, constants.CHANGED * gone[:, 3])
        wrong = np.flatnonzero(np.vecdot(gone[:, :3], gone[:, :3]) > most**2).tolist()
        for k in wrong:
            rate = table[k, 6:] + gone[k, :3] / (len(self._gone) * self._dt)
            found[k] = replace(found[k], velocity=point(rate))
        return found, wrong


def _beside(places: Array, p: Array, q: Array) -> float:
    """The most by which places (N, 3) are off the segment from p to q (3,)."""
    axis = q - p
    share = np.clip((places - p) @ axis / max(float(axis @ axis), TINY), 0.0, 1.0)
    off = places - p - share[:, None] * axis
    return float(np.sqrt(np.vecdot(off, off).max()))


def _extremes(places: Array) -> tuple[Array, Array]:
    """Two of the places (N, 3) that are farthest apart, on or near a line."""
    p = places[_farthest(places, places[-1])]
    return p, places[_farthest(places, p)]


def _spring(places: Array, steps: Array, looks: int) -> Array:
    """Turning points (2, 3) of what was at places (T, 3) with such steps; (0, 3) if none is seen.

    What brakes evenly is a spring without an end: no farther than it goes at its fastest.
    """
    squares, none = np.vecdot(steps, steps), np.zeros((0, 3))
    most = float(squares.max())
    if most - squares.min() <= constants.CHANGED * most:
        return none
    along = steps[int(squares.argmax())] / np.sqrt(most)
    s = (places - places[-1]) @ along
    off = places - places[-1] - s[:, None] * along
    if (
        len(s) < 3
        or np.ptp(s) < constants.STRAIGHT
        or np.vecdot(off, off).max() > constants.STRAIGHT**2
    ):
        return none
    powers = np.vander(s, 3)
    scale = np.sqrt((powers * powers).sum(axis=0))  # as np.polyfit, which warns of few places
    a, b, c = np.linalg.lstsq(powers / scale, squares, len(s) * EPS)[0] / scale
    peak = c - b * b / (4 * a) if a < 0.0 else 0.0
    rest = squares - powers @ (a, b, c)
    if peak <= 0.0 or (
        len(s) >= constants.FEWEST_LOOKS
        and np.sqrt(rest @ rest / len(s)) > constants.UNEVEN * np.ptp(squares)
    ):
        return none
    far, half = looks * np.sqrt(most), np.sqrt(-peak / a)
    ends = np.clip(-b / (2 * a) + half * np.array([-1.0, 1.0]), -far, far)
    return np.asarray(places[-1] + ends[:, None] * along)


def about(obstacle: Obstacle, first: Array, last: Array, wide: float = 0.0) -> Obstacle:
    """The still capsule about an obstacle with its middle anywhere between two points (3,).

    It sweeps a parallelogram with rounded corners: the longer of way and rod is the axis.
    """
    way, rod = (last - first) / 2, (np.array(obstacle.b) - obstacle.a) / 2
    long, short = (way, rod) if way @ way >= rod @ rod else (rod, way)
    along = long / max(float(np.linalg.norm(long)), TINY)
    half = long + abs(float(short @ along)) * along
    wide += float(np.linalg.norm(short - (short @ along) * along))
    middle = (first + last) / 2
    return replace(
        obstacle,
        a=point(middle - half),
        b=point(middle + half),
        radius=obstacle.radius + wide,
        velocity=constants.STILL,
    )


def _farthest(places: Array, one: Array) -> int:
    off = places - one
    return int(np.vecdot(off, off).argmax())


def point(values: Array) -> Point:
    """Three plain numbers."""
    x, y, z = (float(v) for v in values)
    return x, y, z

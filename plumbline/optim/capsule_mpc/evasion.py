r"""Out of the way of what comes: an obstacle as fast as a tip is to be evaded before it is near.

A plan over a fifth of a second, or one step, brakes before what stands. What comes overtakes a
shaft that only gives way: between trocar and tip a shaft moves by a share of what its tip does. So
for every instrument it is asked whether it could stand where it is, in the obstacle's way,

.. math:: g(u) = \min_{0 \le t \le \tau}\ \min_k\ d\big(S(x_0 + t u),\ O_k + t v_k\big) - D_k,
          \qquad g(0) \ge 0

and if not, it is sent on to its goal if that keeps clear, or else at a constant rate u that does:
one outside of the velocity obstacle (Fiorini, Shiller 1998, Int. J. Robotics Research 17(7)), of
those the nearest to the way to its goal; where none keeps clear, the one that comes nearest to it.
Where that one touches, it is said at once.
A rate that kept clear keeps clear at the next step as well, while obstacles go straight on.

How far ahead (:math:`\tau`) an obstacle is believed to do so, it shows: as long as it last did.
"""

from collections.abc import Sequence
from itertools import product

import casadi as cs
import numpy as np

from plumbline.kinematics.capsules import nearest
from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.bodies import Obstacle, TipInstrument, shafts
from plumbline.optim.capsule_mpc.statement import Statement
from plumbline.optim.capsule_mpc.sweeps import about, point
from plumbline.optim.core.problem import Array, Flags

AROUND = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
AROUND /= np.linalg.norm(AROUND, axis=1, keepdims=True)


class Evasion:
    """Goals of instruments that cannot stay where they are; nothing for other bodies."""

    def __init__(self, statement: Statement) -> None:
        bodies = [b for b in statement.bodies if isinstance(b, TipInstrument)]
        self._bodies = bodies if len(bodies) == len(statement.bodies) else []
        self._speed = float(statement.speed.max())
        self._dt = statement.settings.dt
        self._times = np.arange(0.0, constants.AHEAD + constants.EVERY / 2, constants.EVERY)
        self._finer = np.arange(
            0.0, constants.AHEAD + constants.EVERY / 2, constants.EVERY / constants.FINER
        )
        self._margins = statement.settings.apart
        self._trocars = constants.MM * np.array([b.trocar for b in self._bodies]).reshape(-1, 3)
        self._lengths = constants.MM * np.array([b.length for b in self._bodies])
        self._radii = constants.MM * np.array([b.radius for b in self._bodies])
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self._out: list[Array | None] = [None] * len(self._bodies)
        self.overlap = np.zeros(len(self._bodies))  # that the best way out comes to (I,) [mm]

    def goal(
        self, x0: Array, rate: Array, goal: Array, obstacles: Sequence[Obstacle], believed: Array
    ) -> Array:
        """The goal, (g,) or (p, g) [mm], with a way out in it for whom something comes at.

        Obstacles are believed to go straight on for (K,) [s]; tips move at a rate (n,) [mm/s] now.
        """
        self.overlap[:] = 0.0
        if not self._bodies or all(o.velocity == constants.STILL for o in obstacles):
            return goal
        table = np.array([(*o.a, *o.b, *o.velocity, o.radius) for o in obstacles])
        tips = x0.reshape(-1, 3)
        stand = shafts(tips, self._trocars, self._lengths)
        hit = self._in_the_way(stand, table, believed)
        self._out = [out if hit[i] else None for i, out in enumerate(self._out)]
        if not hit.any():
            return goal
        found = goal.copy()
        for i in np.flatnonzero(hit).tolist():
            own = slice(3 * i, 3 * i + 3)
            both = [self._ahead(i, stand, table, believed, t) for t in (self._times, self._finer)]
            place = goal[..., own].reshape(-1, 3)[-1]
            out = self._way(i, tips[i], rate[own], place, both)
            self._out[i] = out
            if out is not None:
                found[..., own] = tips[i] + constants.AHEAD * out
        return found

    def _in_the_way(self, shafts: Array, table: Array, believed: Array) -> Flags:
        """Which of the shafts (I, 2, 3) is hit where it stands."""
        middle, half = (table[:, :3] + table[:, 3:6]) / 2, (table[:, 3:6] - table[:, :3]) / 2
        way = believed[:, None] * table[:, 6:9]
        swept = np.stack([middle, middle + way], axis=1)
        shape = (len(shafts), len(table))
        pairs = np.repeat(shafts, shape[1], axis=0), np.tile(swept, (shape[0], 1, 1))
        least = self._radii[:, None] + table[:, 9] + self._margins[1]
        near = nearest(*pairs).distance.reshape(shape) - np.sqrt(np.vecdot(half, half)) < least
        near &= way.any(axis=1)
        hit = near.any(axis=1)
        # For a sphere this is exact; a rod may pass with its end foremost.
        for i in np.flatnonzero(hit).tolist():
            if (half[near[i]] != 0.0).any():
                seen = table[near[i]], believed[near[i]]
                ahead, radii = self._ahead(i, shafts[:0], *seen, self._times)
                still = np.broadcast_to(shafts[i, 0], (1, len(self._times), 3))
                hit[i] = _gaps(self._bodies[i], still, ahead, radii)[0] < 0.0
        return hit

    def _ahead(
        self, i: int, shafts: Array, table: Array, believed: Array, times: Array
    ) -> tuple[Array, Array]:
        """Where all that shaft i is to keep clear of will be (K, T, 2, 3); radii, margins (K,)."""
        every = float(times[1])
        table = self._between(table, every)
        ends, way = table[:, :6].reshape(-1, 1, 2, 3), table[:, None, None, 6:9]
        ahead = ends + times[:, None, None] * way
        rates = table[:, 6:9]
        gone = (np.vecdot(rates, rates)[:, None] > 0.0) & (times > believed[:, None] + every / 2)
        ahead[gone] = constants.FAR
        others = np.array([k != i for k in range(len(shafts))], dtype=bool)
        stand = np.broadcast_to(shafts[others, None], (int(others.sum()), *ahead.shape[1:]))
        wide = self._radii[: len(shafts)][others] + self._margins[0]
        return np.concatenate([ahead, stand]), np.append(table[:, 9] + self._margins[1], wide)

    def _between(self, table: Array, every: float) -> Array:
        """The same obstacles, faster ones as all that they sweep between two looks."""
        found = table.copy()
        for k in np.flatnonzero(np.vecdot(table[:, 6:9], table[:, 6:9]) > self._speed**2):
            a, b, rate = table[k, :9].reshape(3, 3)
            middle, way = (a + b) / 2, every / 2 * rate
            wide = about(Obstacle(point(a), point(b), table[k, 9]), middle - way, middle + way)
            found[k, :6], found[k, 9] = (*wide.a, *wide.b), wide.radius
        return found

    def _way(
        self, i: int, tip: Array, rate: Array, goal: Array, both: Sequence[tuple[Array, Array]]
    ) -> Array | None:
        """A rate (3,) that keeps clear; None if the way to the goal does."""
        body, way, last = self._bodies[i], goal - tip, self._out[i]
        # Largest speed of a tip (3,) that the other end lets it have [mm/s]
        x, c = cs.SX(cs.DM(tip)), cs.SX(cs.DM(body.constants))
        speed = float(cs.evalf(body.pace(x, c, self._dt)[0]))
        toward = way / max(float(np.linalg.norm(way)), constants.TOUCHING) * speed
        first = [toward] if last is None else [toward, last]
        rates = np.concatenate([first, *(share * speed * AROUND for share in constants.SHARES)])

        def gaps(rates: Array, seen: tuple[Array, Array], times: Array) -> Array:
            change = (rates - rate)[:, None]
            turn = np.maximum(
                np.sqrt(np.vecdot(change, change)) / (constants.MM * body.a_max), self._dt
            )
            s = np.minimum(times, turn)
            tips = tip + times[:, None] * rates[:, None]
            tips -= (s * (1.0 - (s + self._dt) / (2.0 * turn)))[..., None] * change
            if (rates[0] == toward).all():
                beyond = (tips[0] - goal) @ way > 0.0
                tips[0, beyond] = goal
            return _gaps(body, tips, *seen)

        rough = gaps(rates, both[0], self._times)
        if rough[0] >= constants.ROOM:
            return None
        own, clear = rates[len(first) :], rough[len(first) :] >= constants.ROOM
        if clear.any():
            fresh = own[np.where(clear, own @ way, -np.inf).argmax()][None]
        else:
            best = np.argsort(-rough[len(first) :], kind="stable")
            fresh = np.concatenate([own[best[: constants.LIKELY]], _about(own[best[0]])])
        rates = np.concatenate([rates[: len(first)], fresh])
        fine = gaps(rates, both[1], self._finer)
        self.overlap[i] = max(-float(fine.max() + self._margins[1]), 0.0)
        enough = fine >= min(constants.ROOM, float(fine.max()))
        if enough[0]:
            return None
        if last is not None and enough[1]:
            return last
        return rates[1:][np.where(enough[1:], rates[1:] @ way, -np.inf).argmax()]


def _about(rate: Array) -> Array:
    """Rates (C, 3) as large as one (3,), turned aside from it."""
    along = rate / np.linalg.norm(rate)
    across = AROUND - (AROUND @ along)[:, None] * along
    size = np.sqrt(np.vecdot(across, across))
    across = across[size > constants.ASIDE] / size[size > constants.ASIDE, None]
    turned = along + constants.ASIDE * across
    size = np.linalg.norm(rate) / np.sqrt(np.vecdot(turned, turned))
    return np.asarray(size[:, None] * turned)


def _gaps(body: TipInstrument, tips: Array, ahead: Array, radii: Array) -> Array:
    """Least gap (C,) on ways of the tip (C, T, 3) to capsules (K, T, 2, 3), -inf beyond a limit."""
    trocar = body.constants
    own = shafts(tips, trocar, constants.MM * body.length)
    shape = (len(ahead), *own.shape)
    both = (np.broadcast_to(v, shape).reshape(-1, 2, 3) for v in (own, ahead[:, None]))
    found = nearest(*both).distance.reshape(shape[:3])
    least = (found - radii[:, None, None]).min(axis=(0, 2)) - constants.MM * body.radius
    inside = tips - trocar
    depth = np.linalg.norm(inside, axis=-1)
    inward = np.array(body.inward) / np.linalg.norm(body.inward)
    below = inside @ inward - np.cos(np.radians(body.cone)) * depth
    shallowest, deepest = constants.MM * np.array(body.depths)
    kept = (depth >= shallowest) & (depth <= deepest) & (below >= 0.0)
    # Who begins beyond a limit may go anywhere: the planner brings it back.
    return np.where((kept | ~kept[:, :1]).all(axis=1), least, -np.inf)

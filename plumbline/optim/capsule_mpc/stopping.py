r"""How a motion stops: as fast as acceleration and jerk allow.

With the rate u and the acceleration a of a group of states, every step takes the acceleration as
far as the jerk lets it towards the one that is wanted,

.. math:: a^+ = a + (a^* - a)\, \min(1,\ j\, dt / |a^* - a|), \qquad u^+ = u + dt\, a^+, \qquad
          a^* = -\frac{u}{|u|}\, \min(|u| / dt,\ a_{max},\ r), \quad
          r = \tfrac12 \big(\sqrt{(j\, dt)^2 + 8 j |u|} - j\, dt\big)

where a deceleration r, taken back by j dt in every step, uses up what is left of the rate. Between
two stops that keep speed, acceleration and jerk within their bounds every mixture of the two keeps
them too, since the bounds are convex and the dynamics linear: this is what makes the stop at hand a
way out at every step (:mod:`.controller`).
"""

from __future__ import annotations

from functools import lru_cache

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.optim.capsule_mpc.compiled import Compiled
from plumbline.optim.capsule_mpc.statement import Shape, Statement

Array = NDArray[np.float64]
REST = 1e-6  # of the largest rate, below which a stop has ended
MOST = 60  # steps that a stop may take at most


def _braked(u: cs.SX, a: cs.SX, most: float, jerk: float, dt: float) -> tuple[cs.SX, cs.SX]:
    """Rate and acceleration of a group one step on."""
    size = cs.sqrt(cs.sumsqr(u) + 1e-18)
    room = (cs.sqrt((jerk * dt) ** 2 + 8 * jerk * size) - jerk * dt) / 2
    wanted = -u / size * cs.fmin(cs.fmin(size / dt, most), room)
    change = wanted - a
    share = cs.fmin(1.0, jerk * dt / cs.sqrt(cs.sumsqr(change) + 1e-18))
    a = a + share * change
    return u + dt * a, a


def _stop(statement: Statement, steps: int) -> cs.Function:
    u, a = cs.SX.sym("u", statement.n), cs.SX.sym("a", statement.n)
    dt, begin, groups = statement.settings.dt, 0, []
    for size in statement.groups:
        own = slice(begin, begin + size)
        limits = float(statement.acceleration[begin]), float(statement.jerk[begin])
        rate, change, rates = u[own], a[own], []
        for _ in range(steps):
            rate, change = _braked(rate, change, *limits, dt)
            rates.append(rate)
        groups.append(cs.horzcat(*rates))
        begin += size
    return cs.Function("stop", [u, a], [cs.densify(cs.vertcat(*groups))])


@lru_cache(maxsize=16)
def _made(shape: Shape) -> tuple[cs.Function, int]:
    """The stop in as many steps as it takes from the largest rate, still growing."""
    own = shape.statement
    longest, dt, begin = 1, own.settings.dt, 0
    for size in own.groups:
        speed, most, jerk = (float(v[begin]) for v in (own.speed, own.acceleration, own.jerk))
        one = cs.SX.sym("u"), cs.SX.sym("a")
        step = cs.Function("s", list(one), list(_braked(*one, most, jerk, dt)))
        rate, change, count = speed, min(most, speed / dt), 0
        while (abs(rate) > REST * speed or abs(change) > jerk * dt) and count < MOST:
            rate, change = (float(v) for v in step(rate, change))
            count += 1
        # One more for a rate that is put right after it was limited.
        longest, begin = max(longest, count + 1), begin + size
    return _stop(own, longest), longest


class Stop:
    """The stop of a statement from any rate."""

    def __init__(self, statement: Statement) -> None:
        """Build it."""
        function, self.steps = _made(statement.shape)
        self._function = Compiled(function, False)
        self._rest = REST * statement.speed
        self._n, self._dt = statement.n, statement.settings.dt

    def after(self, rate: Array, before: Array) -> Array | None:
        """Rates (T, n) of the stop after a rate (n,) that follows another; None if T is too few."""
        found = self._function(rate, (rate - before) / self._dt)[0].reshape(-1, self._n)
        return np.where(np.abs(found) > self._rest, found, 0.0) if self._ends(found) else None

    def _ends(self, rates: Array) -> bool:
        return bool((np.abs(rates[-1]) <= self._rest).all())


def farthest_within(
    begin: Array, end: Array, centres: Array, radii: Array, groups: tuple[int, ...]
) -> Array:
    """The last point (n,) on the way from one to another, group by group, that lies in all balls.

    Args:
        begin: A point (n,), whose groups lie in their balls.
        end: Another (n,).
        centres: Of the balls (B, n).
        radii: Of the balls (B, n), the same for all states of a group.
        groups: Sizes of the groups.
    """
    at = np.cumsum([0, *groups[:-1]])
    way, off = end - begin, begin - centres
    a = np.add.reduceat(way * way, at)
    b = np.add.reduceat(off * way, at, axis=1)
    c = np.add.reduceat(off * off, at, axis=1) - radii[:, at] ** 2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    share = np.where(a > 0.0, (root - b) / np.where(a > 0.0, a, 1.0), 1.0)
    inside = a + 2 * b + c <= 0.0
    share = np.where(inside, 1.0, np.clip(share, 0.0, 1.0)).min(axis=0)
    return begin + np.repeat(share, groups) * way

r"""How a motion stops, as fast as acceleration and jerk allow, and how what is held stays held.

With the rate u and the acceleration a of a group of states, every step takes the acceleration as
far as the jerk lets it towards the one that is wanted,

.. math:: a^+ = a + (a^* - a)\, \min(1,\ j\, dt / |a^* - a|), \qquad u^+ = u + dt\, a^+, \qquad
          a^* = -\frac{u}{|u|}\, \min(|u| / dt,\ a_{max},\ r), \quad
          r = \tfrac12 \big(\sqrt{(j\, dt)^2 + 8 j |u|} - j\, dt\big)

where a deceleration r, taken back by j dt in every step, uses up what is left of the rate. Between
two stops that keep speed, acceleration and jerk within their bounds every mixture of the two keeps
them too, since the bounds are convex and the dynamics linear: this is what makes the stop at hand a
way out at every step (:mod:`.controller`).

A program treats ``held`` to first order, so a step of it would miss a trocar by the curvature of
the arm. The state after the step is put right by Newton's method along the shortest way,
:math:`x \leftarrow x - E^+ e(x)` with :math:`E = \partial e / \partial x`.
"""

from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.optim.capsule_mpc.compiled import Compiled
from plumbline.optim.capsule_mpc.constants import AT_REST, EXACT, MOST_OF_A_STOP, NO_WAY, REST
from plumbline.optim.capsule_mpc.statement import Statement, StatementShape
from plumbline.optim.core.problem import Array


def _braked(u: cs.SX, a: cs.SX, most: float, jerk: float, dt: float) -> tuple[cs.SX, cs.SX]:
    """Rate and acceleration of a group one step on."""
    size = cs.sqrt(cs.sumsqr(u) + AT_REST)
    room = (cs.sqrt((jerk * dt) ** 2 + 8 * jerk * size) - jerk * dt) / 2
    wanted = -u / size * cs.fmin(cs.fmin(size / dt, most), room)
    change = wanted - a
    share = cs.fmin(1.0, jerk * dt / cs.sqrt(cs.sumsqr(change) + AT_REST))
    a = a + share * change
    return u + dt * a, a


def _stop(statement: Statement, steps: int) -> cs.Function:
    u, a = cs.SX.sym("u", statement.n), cs.SX.sym("a", statement.n)
    dt, groups, excess = statement.settings.dt, [], cs.SX(0.0)
    for own in statement.blocks:
        speed, most, jerk = _bounds(statement, own)
        rate, change, rates = u[own], a[own], []
        for _ in range(steps):
            rate, change = _braked(rate, change, most, jerk, dt)
            rates.append(rate)
            excess = cs.fmax(excess, cs.norm_2(rate) / speed)
        groups.append(cs.horzcat(*rates))
    return cs.Function("stop", [u, a], cs.cse([cs.densify(cs.vertcat(*groups)), excess]))


def _bounds(statement: Statement, group: slice) -> list[float]:
    """Largest rate, acceleration and jerk of a group."""
    bounds = (statement.speed, statement.acceleration, statement.jerk)
    return [float(bound[group.start]) for bound in bounds]


@lru_cache(maxsize=16)
def _made(shape: StatementShape) -> tuple[cs.Function, int]:
    """The stop in as many steps as it takes from the largest rate, still growing."""
    own = shape.statement
    longest, dt = 1, own.settings.dt
    for group in own.blocks:
        speed, most, jerk = _bounds(own, group)
        one = cs.SX.sym("u"), cs.SX.sym("a")
        step = cs.Function("s", list(one), list(_braked(*one, most, jerk, dt)))
        rate, change, count = speed, min(most, speed / dt), 0
        while (abs(rate) > REST * speed or abs(change) > jerk * dt) and count < MOST_OF_A_STOP:
            rate, change = (float(v) for v in step(rate, change))
            count += 1
        # One more for a rate that is put right after it was limited.
        longest = max(longest, count + 1)
    return _stop(own, longest), longest


class Stop:
    """The stop of a statement from any rate."""

    def __init__(self, statement: Statement) -> None:
        function, self.steps = _made(statement.shape)
        self._function = Compiled(function, False)
        self._rest = REST * statement.speed
        self._n, self._dt = statement.n, statement.settings.dt

    def after(self, rate: Array, before: Array, most: float = np.inf) -> Array | None:
        """Rates (T, n) of the stop after a rate (n,) that follows another; None if too fast."""
        values, excess = self._function(rate, (rate - before) / self._dt)
        found = values.reshape(-1, self._n)
        size = np.abs(found)
        if excess[0] > most or (size[-1] > self._rest).any():
            return None
        return np.where(size > self._rest, found, 0.0)


def _share_within(begin: cs.SX, way: cs.SX, centre: cs.SX, radius: cs.SX) -> cs.SX:
    """How much of a way from a point of a ball lies in the ball, at most 1."""
    off = begin - centre
    a, b, c = cs.sumsqr(way), cs.dot(off, way), cs.sumsqr(off) - radius**2
    root = cs.sqrt(cs.fmax(b * b - a * c, 0.0))
    share = cs.fmax((root - b) / cs.fmax(a, NO_WAY), 0.0)
    return cs.if_else(a + 2 * b + c <= 0.0, 1.0, cs.fmin(share, 1.0))


def limited_function(statement: Statement) -> cs.Function:
    """``(x, stage, b, u, u1, u2) -> (n,)``: as far from b towards u as the limits allow.

    In the balls of speed, acceleration and jerk, given the last two rates; b is to lie in them.
    """
    x, _, stage = statement.symbols
    begin, end, last, before = (cs.SX.sym(k, statement.n) for k in ("b", "u", "u1", "u2"))
    dt, found = statement.settings.dt, []
    trusted = statement.step[0] / (dt * statement.speed)
    for own in statement.blocks:
        way, (_, most, jerk) = end[own] - begin[own], _bounds(statement, own)
        balls = (
            (0.0 * way, float(trusted[own.start]) * statement.pace[own.start]),
            (last[own], dt * most),
            (2 * last[own] - before[own], dt**2 * jerk),
        )
        shares = [_share_within(begin[own], way, *ball) for ball in balls]
        found.append(begin[own] + cs.mmin(cs.vertcat(*shares)) * way)
    inputs = [x, stage, begin, end, last, before]
    return cs.Function("limited", inputs, cs.cse([cs.densify(cs.vertcat(*found))]))


@lru_cache(maxsize=16)
def _held(shape: StatementShape) -> Compiled:
    statement = shape.statement
    x, _, stage = statement.symbols
    held = cs.densify(statement.held)
    outputs = cs.cse([held, cs.densify(cs.jacobian(held, x).T)])
    return Compiled(cs.Function("held", [x, stage], outputs), False)


def held_exactly(statement: Statement, x: Array, stage: Array, passes: int = 4) -> Array:
    """The state nearest x (n,) at which all that is held is zero, by Newton's method."""
    found = x.copy()
    for _ in range(passes if statement.held.numel() else 0):
        off, slope = _held(statement.shape)(found, stage)
        if np.abs(off).max() < EXACT:
            break
        E = slope.reshape(len(off), -1)
        found = found - E.T @ np.linalg.lstsq(E @ E.T, off, rcond=None)[0]
    return found


def how_far_off(statement: Statement, x: Array, stage: Array) -> float:
    """The most by which anything held is not zero at x (n,), as it is stated (mm for a trocar)."""
    if not statement.held.numel():
        return 0.0
    return float(np.abs(_held(statement.shape)(x, stage)[0]).max())

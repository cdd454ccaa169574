r"""Commands that are near to where the joints are wanted, all postures at once.

.. math:: q_{k+1} = q_k + B_k^{-1}\,(p_w - p(q_k)), \qquad
          B_{k+1}\,(q_{k+1} - q_k) = p(q_{k+1}) - p(q_k)

:math:`B_0^{-1}` is of the nominal arm's slope where the joints are wanted: a damped least-squares
step of place and orientation, then the shortest one that brings the place all the way. What was
found turns that slope by some thousandths, and what each step has done betters it without touching
it (Broyden 1965, Math. Comp. 19, p. 577; by its steps alone: Kelley 1995, Iterative Methods for
Linear and Nonlinear Equations, sec. 7.3).

Commands along a path, where a joint remembers the way that it came.

.. math:: r = q + a\,\lambda_w(q) \quad\Rightarrow\quad q = r - a\,\lambda_{w - a}(r)

A play of width w that moves the link by a times its lag is undone by the lag of a narrower play
along the link's own path r (Brokate and Sprekels 1996, Hysteresis and Phase Transitions, ch. 2).
So lags are told by where the links shall be: with them held every posture stands alone, and where
the links shall be is told anew by what was commanded.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from types import MappingProxyType

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.kinematics.effects.hysteresis import Hysteresis
from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.core.problem import Array, Indices
from plumbline.optim.model import constants
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.constants import LAG_ROUNDS, NARROWEST, PLACED
from plumbline.optim.model.fitted import by_effect
from plumbline.optim.model.rows import Columns, of_rows
from plumbline.optim.model.statement import ModelFunctions

Context = Mapping[str, ArrayLike]  # of rows, by name


def near(
    arm: Arm,
    wanted: Array,
    goal: Array,
    context: Context,
    *,
    placed: bool,
    held: Columns = MappingProxyType({}),
) -> tuple[Array, Array, Indices]:
    """Joints (N, n), what they miss (N, 6) [m, rad], and which of them did not get there.

    They are wanted at (N, n) [rad or m], the tool at goals (N, 4, 4) [m]; its orientation counts if
    ``placed``. Columns (N, k) ``held`` stay as they are: all that a joint remembers of its path.
    """
    gain = over_rows(_gain(arm.nominal.statement, placed), wanted)[0].transpose(0, 2, 1)
    q, miss = wanted.copy(), np.full((len(wanted), 6), np.nan)
    rows, steps, open_rows = np.arange(len(q)), list[Array](), np.ones(len(q), dtype=bool)
    for _ in range(constants.NEAR_STEPS):
        if not len(rows):
            break
        told, kept = of_rows(context, rows, len(q)), {n: v[rows] for n, v in held.items()}
        miss[rows] = missing(arm, q[rows], goal[rows], told, placed=placed, held=kept)
        with np.errstate(all="ignore"):  # what does not come to rest is told by what it misses
            step = _bettered(np.einsum("nij,nj->ni", gain[rows], miss[rows]), steps)
        there = (np.linalg.norm(miss[rows, :3], axis=1) <= constants.PLACED) & (
            abs(step) <= constants.STILL
        ).all(1)
        open_rows[rows] = ~there
        to = q[rows] + step
        inside = (to >= arm.chain.lower) & (to <= arm.chain.upper)
        on = ~there & (inside & (abs(to - wanted[rows]) <= constants.FARTHEST)).all(axis=1)
        rows, steps = rows[on], [one[on] for one in (*steps, step)]
        q[rows] = to[on]
    return q, miss, np.flatnonzero(open_rows)


def missing(
    arm: Arm,
    q: Array,
    goal: Array,
    context: Context,
    *,
    placed: bool,
    held: Columns = MappingProxyType({}),
) -> Array:
    """What is missing to goals (N, 4, 4): place [m], and turn [rad] where it counts (N, 6)."""
    read = arm.statement.values({**arm.columns(q, context, arm.statement.used), **held})
    goals = np.hstack([goal[:, :3, :3].transpose(0, 2, 1).reshape(-1, 9), goal[:, :3, 3]])
    return over_rows(_away(arm.statement, placed), np.hstack([read, goals]))[0][:, 0]


def _bettered(step: Array, steps: Sequence[Array]) -> Array:
    """A step (N, n) of the first slope as it is after the steps that were made."""
    for one, then in pairwise(steps):
        step = step + then * _along(step, one)
    return step / (1.0 - _along(step, steps[-1])) if steps else step


def _along(step: Array, one: Array) -> Array:
    """How many times a step (N, n) goes along another (N, 1)."""
    return np.asarray((step * one).sum(axis=1) / (one**2).sum(axis=1))[:, None]


@lru_cache(maxsize=8)
def _gain(nominal: ModelFunctions, placed: bool) -> cs.Function:
    """``q -> (n, 6)``: the step for what is missing in place [m] and orientation [rad]."""
    row = nominal.row
    J = nominal.slope(row)[1]
    own, turns = J[:3, :], constants.NEAR_LEVER * J[3:, :] if placed else 0.0 * J[3:, :]
    whole, lever = cs.vertcat(own, turns), cs.diag([1.0] * 3 + [constants.NEAR_LEVER] * 3)
    first = _damped(whole.T @ whole, whole.T)
    rest = cs.horzcat(cs.SX.eye(3), cs.SX(3, 3)) - own @ first
    gain = (first + own.T @ _damped(own @ own.T, rest)) @ lever
    return cs.Function("gain", [row], [cs.densify(gain)])


def _damped(square: cs.SX, right: cs.SX) -> cs.SX:
    """The solution by Cholesky's factor of a damped square (n, n)."""
    factor = cs.chol(square + constants.NEAR_DAMPING**2 * cs.SX.eye(square.shape[0]))
    return cs.solve(factor, cs.solve(factor.T, right))


@lru_cache(maxsize=8)
def _away(model: ModelFunctions, placed: bool) -> cs.Function:
    """``(row, R (9,), p (3,)) -> (6,)``: what is missing to a goal, place [m] and turn [rad].

    A turn by 120 degrees or more is none that is near, and none counts where the place is all.
    """
    goal, pose = cs.SX.sym("goal", 12), model.pose(model.row)
    R = cs.reshape(goal[:9], 3, 3) @ cs.reshape(pose[:9], 3, 3).T
    axis = 0.5 * cs.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    size = cs.sqrt(cs.sumsqr(axis) + np.finfo(float).tiny)
    turn = axis * cs.atan2(size, 0.5 * (cs.trace(R) - 1.0)) / size
    turn = cs.if_else(cs.trace(R) > 0.0, turn, np.inf) if placed else cs.SX.zeros(3)
    away = cs.densify(cs.vertcat(goal[9:] - pose[9:], turn))
    return cs.Function("away", [cs.vertcat(model.row, goal)], [away])


def pathed(
    arm: Arm, wanted: Array, goal: Array, context: Context, *, placed: bool
) -> tuple[Array, Array, Indices]:
    """As :func:`.near` for an arm some of whose joints remember their path, to twice as much."""
    columns = arm.columns(wanted, context)
    parts = by_effect(arm.effects, arm.values)
    plays = [(e, float(v[0])) for e, v in parts if isinstance(e, Hysteresis)]  # and what they move
    q, moved = wanted, np.zeros((len(plays), len(wanted)))
    for _ in range(LAG_ROUNDS):
        before = moved
        lags = [_lag(play, size, {**columns, "q": q}, own)
                for (play, size), own in zip(plays, moved, strict=True)]  # fmt: skip
        held = {name: lag[:, None] for name, lag in lags}
        moved = np.array([size * lag for (_, size), (_, lag) in zip(plays, lags, strict=True)])
        q, miss, rest = near(arm, wanted, goal, context, placed=placed, held=held)
        if not len(rest) and np.abs(moved - before).max() <= PLACED:
            break
    miss = missing(arm, q, goal, context, placed=placed)
    return q, miss, np.flatnonzero(np.linalg.norm(miss[:, :3], axis=1) > 2 * PLACED)


def _lag(play: Hysteresis, size: float, columns: Columns, moved: Array) -> tuple[str, Array]:
    """A play's column and its lag (N,) where it and its reading together move its link so."""
    links = columns["q"].copy()
    links[:, play.joint - 1] += moved
    scale = 1.0 / max(1.0 - size / play.width, NARROWEST)
    ((name, lag),) = play.derive({**columns, "q": scale * links}).items()
    return name, lag

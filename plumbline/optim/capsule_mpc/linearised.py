r"""The statement about a path: a quadratic program of stages, by symbolic derivatives.

About a path :math:`\bar x_k`, a row with a frozen normal n for a point p of one capsule's axis and
a point q of the other's,

.. math:: G_r x_k \ge h_r: \qquad
          n \cdot (\partial p - \partial q)(x_k - \bar x_k) \ge D - n \cdot (p - q)(\bar x_k)

The plane between two shafts turns with them: one row for the nearest points, and one for each end
of the overlap, where parallel shafts touch next; each has its own normal. (One normal for all pairs
of ends forbids what a trocar needs: a shaft that turns about its trocar leaves the plane with one
end, whichever way it turns.) Between these points a convex distance cannot dip by more than a part
of what the shafts move in one step. A sphere needs one row. The scalar form has the nearest points'
row only, which is what makes it fail where shafts are parallel. Tracking is linearised in
the manner of Gauss and Newton; ``held`` becomes a stiff quadratic. The function of a stage is
mapped over the horizon, and compiled where there is a compiler.

Most rows can be left out for certain. While the speed limits hold, state j is within
:math:`w_{kj} = dt\, v_j \sum_{i<k} \alpha(i)` of its present value at stage k, so that

.. math:: G_r x_0 - \sum_j |G_{rj}|\, w_{kj} \ge h_r \ \Rightarrow\ G_r x_k \ge h_r

for every admissible path: the solution with the row and without it is the same.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics import capsules
from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.bodies import sides
from plumbline.optim.capsule_mpc.compiled import Compiled, native_function
from plumbline.optim.capsule_mpc.pairs import Pair
from plumbline.optim.capsule_mpc.statement import Statement, StatementShape
from plumbline.optim.core.problem import Array, Flags, Indices


@dataclass(frozen=True)
class StageQp:
    r"""A quadratic program along a chain of stages, x0 given.

    .. math:: \min \sum_k \tfrac12 x_k^T H_k x_k + g_k^T x_k + effort |x_k - x_{k-1}|^2
              + smooth |x_k - 2 x_{k-1} + x_{k-2}|^2 + \rho \sum_r s_r \ \text{s.t.}\
              |Q_k (x_k - x_{k-1})| \le step_k,\ G_r x_k + s_r \ge h_r,\ s_r \ge 0
    """

    H: Array  # (p, n, n), symmetric
    g: Array  # (p, n)
    G: Array  # (p, m, n)
    h: Array  # (p, m); rows below -1e8 are absent, see :attr:`present`
    x0: Array  # (n,)
    step: Array  # (p, n), of what is turned; of each group's norm where its first state is
    penalty: float  # the cost of slack
    effort: float  # the cost of a squared step
    smooth: float  # the cost of a squared change of a step
    move: Array  # the step (n,) before x0, so that :math:`x_{-1} = x_0 - move`
    # Q (p, n, n), orthogonal and block-diagonal; None for the unit matrix
    turn: Array | None = None
    groups: tuple[int, ...] = ()  # sizes of its blocks

    @property
    def first(self) -> Array:
        """Bounds (n,) on the norms of the first step's groups."""
        begins, owner = _places(self.groups)
        return self.step[0, begins][owner]

    @property
    def upright(self) -> Self:
        """The same with steps bounded state by state, each by its group's bound."""
        if self.turn is None:
            return self
        begins, owner = _places(self.groups)
        return replace(self, step=self.step[:, begins][:, owner], turn=None)

    @property
    def present(self) -> Flags:
        """Which rows (p, m) are there; a right-hand side that is no number is, and is refused."""
        return ~(self.h <= constants.DROPPED)


@dataclass(frozen=True)
class QpPath:
    """What a solver of the program gives."""

    x: Array  # the path (p, n)
    slack: Array  # slack (p, m) of every row [mm]
    multiplier: Array  # multiplier (p, m) of every row
    solved: bool  # whether it converged
    iterations: int  # how many it took


Rows = tuple[list[cs.SX], list[cs.SX]]  # values less D, and gradients (1, n)


def frozen_normal(pair: Pair, difference: cs.SX) -> cs.SX:
    """Unit normal (3,) along a difference of points; across both axes where that vanishes.

    Where they are parallel too, or the second is a point, it is across the first.
    """
    distance, u = cs.norm_2(difference), pair.one.b - pair.one.a
    across = cs.cross(u, pair.two.b - pair.two.a)
    size, length = capsules.length_of(across), capsules.length_of(u)
    aside = sides(cs.if_else(length > constants.TOUCHING, u / length, cs.DM([0.0, 0.0, 1.0])))[0]
    instead = cs.if_else(size > constants.COMMON, across / size, aside)
    return cs.if_else(
        distance > constants.TOUCHING, difference / cs.fmax(distance, constants.TOUCHING), instead
    )


def _row(pair: Pair, x: cs.SX, s: cs.SX, t: cs.SX) -> tuple[cs.SX, cs.SX]:
    """A row for the points at shares s and t."""
    difference = pair.one.point(s) - pair.two.point(t)
    n = frozen_normal(pair, difference)
    slope = cs.SX(1, x.numel())
    ends = ((pair.one.a, 1 - s), (pair.one.b, s), (pair.two.a, t - 1), (pair.two.b, -t))
    for end, share in ends:
        slope += share * (n.T @ cs.jacobian(end, x))
    return cs.dot(n, difference) - pair.wide(pair.least_at(s, t)), slope


def _witness_rows(pair: Pair, x: cs.SX) -> Rows:
    s, t = capsules.nearest_shares(pair.one, pair.two)
    shares = [(s, t)]
    if not pair.ball:
        beside = capsules.overlap_shares(pair.one, pair.two)
        shares += [(s, capsules.share_beside(pair.one.point(s), pair.two)) for s in beside]
    (value, slope), *others = (_row(pair, x, s, t) for s, t in shares)
    # A pair falls short by one number, and not by one for each of its rows: what its nearest points
    # cannot keep, no other points of it need to.
    short = cs.fmax(-value, 0.0)
    return [value, *(v + short for v, _ in others)], [slope, *(s for _, s in others)]


def _scalar_rows(pair: Pair, x: cs.SX) -> Rows:
    gap = capsules.scalar_gap(pair.one, pair.two, pair.wide(pair.least))
    return [gap], [cs.jacobian(gap, x)]


def _rows(statement: Statement) -> tuple[cs.SX, cs.SX]:
    """Transposed rows (n, m) and right-hand sides (m,) of a stage, about x."""
    x, x0, stage = statement.symbols
    make = _scalar_rows if statement.settings.form == "scalar" else _witness_rows
    found = [make(pair, x) for pair in statement.pairs]
    values = [value for pair, _ in found for value in pair]
    slopes = [slope for _, pair in found for slope in pair]
    limits = constants.LIMITS * statement.limits
    G = cs.vertcat(cs.SX(0, x.numel()), *slopes, cs.jacobian(limits, x))
    h = G @ x - cs.vertcat(cs.SX(0, 1), *values, limits)
    # The least that a row can come to while every group of states stays within its reach.
    within, worst = stage[-statement.n :], G @ x0
    for part in statement.blocks:
        own = G[:, part]
        length = cs.sqrt(cs.sum2(own * own)) if own.size2() > 1 else cs.fabs(own)
        worst -= length * within[part.start]
    return G.T, cs.if_else(worst > h, constants.ABSENT, h)


def stage_function(statement: Statement) -> cs.Function:
    """``(x, x0, stage) -> H (n, n), g (n,), transposed rows (n, m), right-hand sides (m,)``."""
    x, x0, stage = statement.symbols
    H, g = cs.SX(x.numel(), x.numel()), cs.SX(x.numel(), 1)
    for weight, value in ((1.0, statement.residual), (statement.settings.hold, statement.held)):
        slope = cs.jacobian(value, x)
        H += 2 * weight * slope.T @ slope
        g += 2 * weight * slope.T @ (value - slope @ x)
    rows, sides = _rows(statement)
    # Pairs share the ends of their capsules and their derivatives: compute them once.
    outputs = cs.cse([cs.densify(value) for value in (H, g, rows, sides)])
    return cs.Function("stage", [x, x0, stage], outputs)


@lru_cache(maxsize=32)
def _mapped(shape: StatementShape, compiler: bool) -> tuple[cs.Function, bool]:
    one, p = stage_function(shape.statement), shape.statement.settings.p
    return native_function(one.map("stages", "serial", p, [1], []), compiler)


@dataclass(frozen=True, eq=False)
class Linearised:
    """A statement, ready to be linearised at every step of a control loop."""

    statement: Statement  # the problem
    compiler: bool = True  # whether to compile, where there is a compiler

    @cached_property
    def _boxes(self) -> Compiled:
        return Compiled(box_function(self.statement.shape), False)

    @cached_property
    def _stages(self) -> Compiled:
        return Compiled(*_mapped(self.statement.shape, self.compiler))

    def prepare(self) -> None:
        """Build, and compile, what the first call would otherwise wait for."""
        _ = self._stages

    @property
    def native(self) -> bool:
        """Whether it was compiled."""
        return self._stages.native

    def about(self, path: Array, x0: Array, stages: Array) -> StageQp:
        """The program about a path (p, n), from x0 (n,), with the stages' parameters (p, t)."""
        p, n = path.shape
        own, s = self.statement, self.statement.settings
        before = np.concatenate([x0[None], path[:-1]])
        steps = path - before
        stages = stages.copy()
        if p == 1:  # a path of one stage is where the motion begins: it goes on as it was
            steps = stages[:, own.moved]
        stages[:, own.stepped] = steps
        most, turn = self._bounds(before, steps, stages)
        H, g, G, h = self._stages(path, x0, stages)
        g = g.reshape(p, n) + self._led(stages[:, : own.goals])
        made = H.reshape(p, n, n), g, G.reshape(p, -1, n), h.reshape(p, -1)
        costs = constants.MM * s.penalty, *s.weights
        return StageQp(*made, x0, most, *costs, stages[0, own.moved], turn, own.groups)

    def _led(self, path: Array) -> Array | float:
        """What the own steps of a path (p, g) that is to be followed add to g (p, n)."""
        effort, smooth = self.statement.settings.weights
        if not (effort or smooth) or (path == path[0]).all():
            return 0.0
        steps, changes = (v.full().T for v in path_function(self.statement.shape)(path.T))
        # Each counts in the terms of its own stage, and of the one or two after it.
        return np.asarray(
            -2 * effort * _less_next(steps) - 2 * smooth * _less_next(_less_next(changes))
        )

    def _bounds(self, before: Array, steps: Array, stages: Array) -> tuple[Array, Array | None]:
        """Sides (p, n) of the boxes that steps stay in, and their turns (p, n, n)."""
        own = self.statement
        pace, sides, turn = self._boxes(before, steps, stages)
        last = norms(stages[0, own.moved], own.groups)
        most = np.minimum(pace.reshape(before.shape) * own.alpha, last + own.ramp)
        p, n = before.shape
        turned = turn.reshape(p, n, n) if max(own.groups) > 1 else None
        return most * sides.reshape(before.shape), turned


def _less_next(values: Array) -> Array:
    """Values (p, n) less those of the next stage; behind the last there is none."""
    return -np.diff(values, axis=0, append=np.zeros_like(values[:1]))


def within_norms(step: Array, most: Array, groups: tuple[int, ...]) -> Array:
    """A step (n,) whose groups are shortened to the bounds on their norms (n,), where longer."""
    return step * np.minimum(1.0, most / np.maximum(norms(step, groups), constants.TOUCHING))


def norms(values: Array, groups: tuple[int, ...]) -> Array:
    """For every number (..., n) the Euclidean norm of its group."""
    begins, owner = _places(groups)
    return np.sqrt(np.add.reduceat(values * values, begins, axis=-1))[..., owner]


@lru_cache(maxsize=32)
def _places(groups: tuple[int, ...]) -> tuple[Indices, Indices]:
    """Where groups begin (G,), and which group each number is of (n,)."""
    begins = np.cumsum([0, *groups[:-1]], dtype=np.intp)
    return begins, np.repeat(np.arange(len(groups)), groups)


@lru_cache(maxsize=32)
def box_function(shape: StatementShape) -> cs.Function:
    """``(x, d, stage) -> pace (n,), sides (n,), turn (n, n)``, the last row by row.

    Of a box that touches the ball of a group's speeds where its step d has it; its sides are
    shares of the ball's radius. A group of another size than 3 is not turned.
    """
    own = shape.statement
    x, _, stage = own.symbols
    d, sides_of, blocks = cs.SX.sym("d", own.n), [], []
    for size, part in zip(own.groups, own.blocks, strict=True):
        step, length = d[part], cs.norm_2(d[part])
        moves = cs.if_else(length > constants.TOUCHING, 1.0, 0.0) if size == 3 else cs.SX(0.0)
        if size == 3:
            up = cs.DM([0.0, 0.0, 1.0])
            u = cs.if_else(
                length > constants.TOUCHING, step / cs.fmax(length, constants.TOUCHING), up
            )
            blocks.append(cs.horzcat(u, *sides(u)))
        else:
            blocks.append(cs.SX.eye(size))
        across = 1.0 - (1.0 - constants.ACROSS) * moves
        sides_of += [1.0] + [across] * (size - 1)
    outputs = [cs.densify(v) for v in (own.pace, cs.vertcat(*sides_of), cs.diagcat(*blocks))]
    one = cs.Function("box", [x, d, stage], cs.cse(outputs))
    return one.map("boxes", "serial", own.settings.p, [], [])


@lru_cache(maxsize=32)
def path_function(shape: StatementShape) -> cs.Function:
    """``points (n, p) -> steps (n, p), changes (n, p)``; zeros where goals are no states."""
    own = shape.statement
    p, points = own.settings.p, cs.SX.sym("r", own.goals, own.settings.p)
    steps = changes = cs.SX.zeros(own.n, p)
    if own.by_states and p > 2:
        later = _shortened(own, points[:, 1:] - points[:, :-1])
        steps = cs.horzcat(2 * later[:, 0] - later[:, 1], later)
        after = steps[:, 1:] - steps[:, :-1]
        changes = cs.horzcat(after[:, 0], after)
    return cs.Function("path", [points], [steps, changes])


def _shortened(own: Statement, steps: cs.SX) -> cs.SX:
    most, rows = own.step[0], []
    for part in own.blocks:
        size = cs.sqrt(cs.sum1(steps[part, :] ** 2))
        share = cs.fmin(1.0, most[part.start] / cs.fmax(size, constants.TOUCHING))
        rows.append(steps[part, :] * cs.repmat(share, part.stop - part.start, 1))
    return cs.vertcat(*rows)

r"""The bounded fit of link parameters, stated in symbols for one reading.

.. math:: \min_X\ F(X) = \frac1n \sum_i \phi\bigl(f(X, q_i) - g(X)\, a_i\bigr)
          \quad\text{s.t.}\quad |x_k - x_k^*| \le \delta_k

after Chen et al., eqs. 8-9: :math:`a_i` is a tip reading in the camera's frame, f the forward
kinematics of the parameters X (d, a, alpha, theta of every row, and beta where axes are parallel),
and g the rigid transform from camera to robot. In the published form g follows from four
registration points, whose robot coordinates are forward kinematics of the *same* X, so f and g
both depend on it (``frame="registration"``). The alternative takes the frame as six free unknowns
on all readings (``frame="joint"``). In both, the frame enters a row as twelve numbers m = g(X)
that are worked out once, not once a row.

Objective, gradient and generalised Gauss-Newton matrix, summed over the readings in chunks.

.. math:: J_i = \frac{\partial f}{\partial x} - \frac{\partial (g a_i)}{\partial m}
          \frac{\partial m}{\partial x}

The frame's derivative is worked out once; a row adds a product with its three coordinates. Memory
is bounded by the chunk, cost is linear in the readings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as cs
import numpy as np

from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import Transform, by_columns, constant, rotation
from plumbline.kinematics.link_table import KEYS, LinkTable
from plumbline.optim.core.constants import CHUNK_NUMBERS
from plumbline.optim.core.mapped import Gram
from plumbline.optim.core.problem import Array, Flags, Indices, Integers, Problem
from plumbline.optim.dh_fit.constants import FRAME_SCALE, TOOL_SCALE, WIDE_BOUNDS
from plumbline.optim.dh_fit.losses import Loss
from plumbline.optim.dh_fit.registration import Registered, check_points, steps_needed
from plumbline.optim.rigid import rigid_match

UNITS = {"d": "m", "a": "m", "alpha": "rad", "theta": "rad", "beta": "rad"}
FRAME = tuple(f"frame {axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
TOOL = tuple(f"tool {axis}" for axis in "xyz")


@dataclass(frozen=True, eq=False)
class Readings:
    """Joint readings and where the camera saw the tip."""

    q: Array  # joint readings (N, n) [rad or m]
    tips: Array  # tip positions (N, 3) in the camera's frame [m]

    def __len__(self) -> int:
        return len(self.q)

    def select(self, rows: Flags | Indices | Integers | Sequence[int]) -> Readings:
        """Some of the readings."""
        return Readings(self.q[rows], self.tips[rows])


@dataclass(frozen=True)
class Unknown:
    """One unknown."""

    name: str  # ``joint 2 a``, ``frame rx``, ``tool z``
    unit: str  # ``m`` or ``rad``
    nominal: float  # where it starts
    delta: float  # how far it may go from there
    scale: float  # by which steps and columns are measured
    # its row and column in the table of links; None for frame and tool
    cell: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class DHStatement:
    """The problem of one robot and one camera; the readings come at the call."""

    table: LinkTable  # the nominal links
    tool: Array  # nominal tip in the tip frame (3,) [m]
    unknowns: tuple[Unknown, ...]  # the unknowns (P), those that are free
    x: cs.SX  # their symbols (P,)
    q: cs.SX  # symbols of a reading's joints (n,)
    tip: cs.SX  # f(X, q), the tip in the robot's frame (3,) [m]
    frame: cs.SX  # g(X): rotation columns, then translation, of ``T_robot_camera`` (12,)
    loss: Loss  # what a misfit costs
    registered: Registered | None = None  # what it follows from, if it does so from four points

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns (P)."""
        return tuple(u.name for u in self.unknowns)

    @property
    def size(self) -> int:
        """Number of unknowns P."""
        return len(self.unknowns)

    @property
    def nominal(self) -> Array:
        """Where they start (P,)."""
        return np.array([u.nominal for u in self.unknowns])

    @property
    def delta(self) -> Array:
        """How far they may go (P,)."""
        return np.array([u.delta for u in self.unknowns])

    @property
    def lower(self) -> Array:
        """Lower bounds (P,)."""
        return self.nominal - self.delta

    @property
    def upper(self) -> Array:
        """Upper bounds (P,)."""
        return self.nominal + self.delta

    @property
    def scale(self) -> Array:
        """Scales (P,)."""
        return np.array([u.scale for u in self.unknowns])

    @cached_property
    def reading(self) -> cs.SX:
        """Symbols of one camera reading (3,) [m]."""
        return cs.SX.sym("reading", 3)

    @cached_property
    def tip_functions(self) -> tuple[cs.Function, cs.Function]:
        """``(x, q) -> f`` and ``(x, q) -> f, (df/dx)^T``."""
        f, J = cs.densify(self.tip), cs.densify(cs.jacobian(self.tip, self.x).T)
        inputs = [self.x, self.q]
        return cs.Function("tip", inputs, [f]), cs.Function("tip_and_slope", inputs, [f, J])

    @cached_property
    def frame_function(self) -> cs.Function:
        """``x -> g (12,), dg/dx (12, P)``."""
        slope = self.registered.slope if self.registered else cs.jacobian(self.frame, self.x)
        outputs = [cs.densify(self.frame), cs.densify(slope)]
        return cs.Function("frame", [self.x], outputs)

    def problem(self, readings: Readings) -> LinkProblem:
        """The problem of some readings: residuals of which half the mean square is the loss."""
        frame = Transform(cs.reshape(self.frame[:9], 3, 3), self.frame[9:])
        misfit = self.tip - frame.point(self.reading)
        return LinkProblem(
            x=self.x,
            names=self.names,
            lower=self.lower,
            upper=self.upper,
            scale=self.scale,
            residual=self.loss.residual(misfit),
            row=cs.vertcat(self.q, self.reading),
            rows=np.hstack([readings.q, readings.tips]),
            weights=np.full(len(readings), 1.0 / len(readings)),
            statement=self,
            readings=readings,
        )

    def links(self, x: Array) -> LinkTable:
        """The table of links at a point (P,)."""
        values = self.table.values
        for value, unknown in zip(x, self.unknowns, strict=True):
            if unknown.cell is not None:
                values[unknown.cell] = value
        return self.table.with_values(values)

    def tool_at(self, x: Array) -> Array:
        """The tip in the tip frame (3,) [m] at a point (P,)."""
        tool = self.tool.copy()
        for value, unknown in zip(x, self.unknowns, strict=True):
            if unknown.name in TOOL:
                tool[TOOL.index(unknown.name)] = value
        return tool

    def frame_at(self, x: Array) -> Array:
        """``T_robot_camera`` (4, 4) [m] at a point (P,)."""
        return by_columns(self.frame_function(x)[0].full().reshape(1, 12))[0]

    def tips(self, x: Array, q: Array) -> Array:
        """Predicted tips (N, 3) in the robot's frame [m]."""
        return over_rows(self.tip_functions[0], q, x)[0][:, 0]


@dataclass(frozen=True, eq=False, repr=False)
class LinkProblem(Problem):
    """The problem of some readings, for any solver of residuals; it knows what it was made of."""

    statement: DHStatement = field(kw_only=True)  # the problem of one reading
    readings: Readings = field(kw_only=True)  # the readings (N)


def link_unknowns(
    table: LinkTable, delta_length: float, delta_angle: float, *, hayati: bool
) -> list[Unknown]:
    """Every parameter of every row; beta where axes are parallel and ``hayati`` asks for it."""
    found = []
    for k, row in enumerate(table.rows):
        for c, (key, value) in enumerate(zip(KEYS, row.values, strict=True)):
            if key == "beta" and not (hayati and row.parallel):
                continue
            delta = delta_length if UNITS[key] == "m" else delta_angle
            found.append(Unknown(f"{row.label} {key}", UNITS[key], value, delta, delta, (k, c)))
    return found


def tool_unknowns(tool: Array) -> list[Unknown]:
    """The tip in the tip frame, as good as unbounded."""
    return [
        Unknown(name, "m", float(value), WIDE_BOUNDS * TOOL_SCALE, TOOL_SCALE)
        for name, value in zip(TOOL, tool, strict=True)
    ]


def frame_unknowns() -> list[Unknown]:
    """Shift and turn of the camera's frame, as good as unbounded."""
    units = ["m"] * 3 + ["rad"] * 3
    pairs = zip(FRAME, units, strict=True)
    return [
        Unknown(name, unit, 0.0, WIDE_BOUNDS * FRAME_SCALE, FRAME_SCALE) for name, unit in pairs
    ]


def state(
    table: LinkTable,
    tool: Array,
    unknowns: Sequence[Unknown],
    loss: Loss,
    *,
    readings: Readings,
    registration: Readings | None,
) -> DHStatement:
    """State the problem of nominal links and tool (3,) [m] in some unknowns.

    A free frame starts from ``readings``; four of ``registration`` fix it, refused if in a plane.
    """
    x = cs.SX.sym("x", len(unknowns))
    at = {u.name: x[k] for k, u in enumerate(unknowns)}
    values = cs.SX(table.values)
    for k, unknown in enumerate(unknowns):
        if unknown.cell is not None:
            values[unknown.cell] = x[k]
    tip_in_tip = cs.vertcat(*(at.get(n, float(v)) for n, v in zip(TOOL, tool, strict=True)))
    q = cs.SX.sym("q", table.chain.n)
    tip = table.tip(values, q, tip_in_tip)
    predict = cs.Function("tip", [x, q], [tip])
    nominal = np.array([u.nominal for u in unknowns])
    registered = None
    if registration is not None:
        check_points(registration.tips)
        points = cs.horzcat(*(predict(x, row) for row in registration.q))
        known = np.array([predict(nominal, row).full().ravel() for row in registration.q])
        steps = steps_needed(known, registration.tips)
        registered = Registered(points, registration.tips, steps, x)
        frame = registered.value
    else:
        T = _free_frame(at, predict, nominal, readings)
        frame = cs.vertcat(cs.vec(T.R), T.t)
    return DHStatement(table, tool, tuple(unknowns), x, q, tip, frame, loss, registered)


def _free_frame(
    at: dict[str, cs.SX], predict: cs.Function, nominal: Array, readings: Readings
) -> Transform:
    """A shift and a turn about the middle of the data, from where nominal tips match best."""
    tips = over_rows(predict, readings.q, nominal)[0][:, 0]
    T = rigid_match(readings.tips, tips)
    middle = constant(tips.mean(axis=0))
    zero = cs.SX(0)
    shift = cs.vertcat(*(at.get(name, zero) for name in FRAME[:3]))
    R = rotation(cs.vertcat(*(at.get(name, zero) for name in FRAME[3:])))
    return Transform(R @ constant(T[:3, :3]), middle + R @ (constant(T[:3, 3]) - middle) + shift)


@dataclass(frozen=True, eq=False)
class Pass:
    """A statement and the readings that it is summed over."""

    statement: DHStatement  # the problem
    readings: Readings  # N readings

    @cached_property
    def problem(self) -> LinkProblem:
        """The problem of these readings."""
        return self.statement.problem(self.readings)

    def misfits(self, x: Array) -> Array:
        """Predicted minus measured (N, 3) [m], in the robot's frame."""
        T = self.statement.frame_at(x)
        seen = self.readings.tips @ T[:3, :3].T + T[:3, 3]
        return self.statement.tips(x, self.readings.q) - seen

    def objective(self, x: Array) -> float:
        """F at a point (P,)."""
        return float(self.statement.loss.values(self.misfits(x)).mean())

    def jacobians(self, x: Array) -> Iterator[tuple[Array, Array]]:
        """Chunks of misfits (n, 3) and their Jacobians (n, 3, P)."""
        stated, size = self.statement, self.statement.size
        m, slope = (part.full() for part in stated.frame_function(x))
        R, t = m[:9].reshape(3, 3).T, m[9:, 0]
        turning = slope[:9].reshape(3, 3 * size)  # one row a coordinate of the reading
        moving = slope[9:]
        step = max(1, CHUNK_NUMBERS // (3 * size))
        for start in range(0, len(self.readings), step):
            part = slice(start, start + step)
            a = self.readings.tips[part]
            f, J = over_rows(stated.tip_functions[1], self.readings.q[part], x)
            J -= (a @ turning).reshape(-1, 3, size)
            J -= moving
            yield f[:, 0] - a @ R.T - t, J

    def gram(self, x: Array) -> Gram:
        """Twice F as a square at a point (P,), its gradient, and the loss's own matrix."""
        size, count, loss = self.statement.size, len(self.readings), self.statement.loss
        total, gradient, matrix = 0.0, np.zeros(size), np.zeros((size, size))
        for e, J in self.jacobians(x):
            c, u = loss.curvatures(e)
            total += float(loss.values(e).sum())
            gradient += np.einsum("nk,nkp->p", loss.slopes(e), J)
            A = (J * np.sqrt(c)[:, None, None]).reshape(-1, size)
            matrix += A.T @ A
            if u.any():
                B = np.einsum("nk,nkp->np", u * np.sqrt(c)[:, None], J)
                matrix -= B.T @ B
        return Gram(matrix / count, gradient / count, 2.0 * total / count, 3.0)

    def curvature_along(self, x: Array, step: Array) -> Array:
        """Nothing (P,): the matrix of a convex loss is no square of residuals that bend."""
        return np.zeros_like(x)

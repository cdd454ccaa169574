"""A row's function mapped over all rows in chunks: residuals, Jacobians, Gram matrices.

Memory is bounded by the chunk, whatever the number of rows; cost is linear in the rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.core.constants import CHUNK_NUMBERS, NEARBY
from plumbline.optim.core.problem import Array, Indices, Problem, Symbols


@dataclass(frozen=True, eq=False)
class Gram:
    r"""Normal equations of one group of rows, about a point x."""

    matrix: Array  # :math:`J^T J` (P, P)
    vector: Array  # :math:`J^T r` (P,)
    square: float  # :math:`r^T r`
    count: float  # number of residuals, weighted

    def __add__(self, other: Gram) -> Gram:
        return Gram(self.matrix + other.matrix, self.vector + other.vector,
                    self.square + other.square, self.count + other.count)  # fmt: skip

    def __sub__(self, other: Gram) -> Gram:
        return Gram(self.matrix - other.matrix, self.vector - other.vector,
                    self.square - other.square, self.count - other.count)  # fmt: skip

    def padded(self, size: int) -> Gram:
        """The same with unknowns behind its own that nothing here depends on."""
        more = size - len(self.vector)
        matrix = np.pad(self.matrix, ((0, more), (0, more)))
        return Gram(matrix, np.pad(self.vector, (0, more)), self.square, self.count)

    def part(self, columns: Indices) -> Gram:
        """The same in some of the unknowns (k,), the others as they are."""
        matrix = self.matrix[np.ix_(columns, columns)]
        return Gram(matrix, self.vector[columns], self.square, self.count)

    @classmethod
    def empty(cls, size: int) -> Gram:
        """Of no rows at all."""
        return cls(np.zeros((size, size)), np.zeros(size), 0.0, 0.0)


class Summed(Protocol):
    """What sums a problem up about a point x (P,)."""

    @property
    def problem(self) -> Problem:
        """The problem."""

    def gram(self, x: Array) -> Gram:
        """Its normal equations."""

    def curvature_along(self, x: Array, step: Array) -> Array:
        """The residuals' second derivative along a step (P,), back to the unknowns (P,)."""


def less_foretold(values: Array, before: Array, follows: Array) -> Array:
    """Rows (N, ...) less what each one's predecessor foretells, at the size that they had.

    ``before`` (1, ...) is the row before the first, ``follows`` (N,) the correlations.
    """
    shape = (-1,) + (1,) * (values.ndim - 1)
    phi = follows.reshape(shape)
    earlier = np.concatenate([before, values[:-1]])
    return np.asarray((values - phi * earlier) / np.sqrt(1.0 - phi**2))


def back_to_rows(white: Array, follows: Array) -> Array:
    """The transpose of :func:`less_foretold`, of rows (N, m)."""
    if not follows.size:
        return white
    sized = white / np.sqrt(1.0 - follows**2)[:, None]
    return np.asarray(sized - np.concatenate([(follows[:, None] * sized)[1:], 0.0 * sized[:1]]))


def _within(follows: Array, groups: Indices | None) -> Array:
    """The correlations (N,) with predecessors of the same group."""
    if groups is None or not follows.size:
        return follows
    same = np.concatenate([[False], groups[1:] == groups[:-1]])
    return np.where(same, follows, 0.0)


class _Statement:
    """Symbols of a problem as a key: the same objects, not merely alike, are the same."""

    def __init__(self, *symbols: Symbols) -> None:
        self.symbols = symbols
        self._key = tuple(_name_of(symbol) for symbol in symbols)

    def __hash__(self) -> int:
        """By identity; the key keeps the symbols alive, so that no other takes their place."""
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        """Whether the symbols are the very same, or the same numbers."""
        return isinstance(other, _Statement) and self._key == other._key


def _name_of(symbol: cs.SX | cs.MX) -> int | str:
    """What tells a symbol from others: which it is, or the number where it is one or nothing."""
    return str(symbol) if symbol.numel() <= 1 and symbol.is_constant() else id(symbol)


@dataclass(frozen=True, eq=False)
class _Compiled:
    """Functions of a statement, compiled when first asked for."""

    statement: _Statement

    @cached_property
    def residual(self) -> cs.Function:
        x, row, residual, *_ = self.statement.symbols
        return cs.Function("residual", [x, row], [cs.densify(residual)])

    @cached_property
    def both(self) -> cs.Function:
        x, row, residual, *_ = self.statement.symbols
        jacobian = cs.densify(cs.jacobian(residual, x).T)
        return cs.Function("both", [x, row], [cs.densify(residual), jacobian])

    @cached_property
    def pulled(self) -> cs.Function:
        """Residuals of a row, each times what it is given, back to the unknowns."""
        x, row, residual, *_ = self.statement.symbols
        given = cs.SX.sym("given", residual.numel())
        slope = cs.densify(cs.jtimes(residual, x, given, True))
        return cs.Function("pulled", [x, cs.vertcat(row, given)], [slope])

    @cached_property
    def shared(self) -> cs.Function:
        x, _, _, shared, *_ = self.statement.symbols
        slope = cs.densify(cs.jacobian(shared, x).T)
        return cs.Function("shared", [x], [cs.densify(shared), slope])

    @cached_property
    def objective(self) -> cs.Function:
        x, *_, f, _, given = self.statement.symbols
        return cs.Function("objective", [x, given], [f, cs.densify(cs.gradient(f, x))])

    @cached_property
    def bend(self) -> cs.Function:
        x, *_, f, _, given = self.statement.symbols
        return cs.Function("bend", [x, given], [cs.densify(cs.hessian(f, x)[0])])

    @cached_property
    def constraints(self) -> cs.Function:
        x, *_, g, given = self.statement.symbols
        return cs.Function("constraints", [x, given], [cs.densify(g)])

    @cached_property
    def slopes(self) -> cs.Function:
        x, *_, g, given = self.statement.symbols
        return cs.Function("slopes", [x, given], [cs.jacobian(g, x)])

    @cached_property
    def lagrangian(self) -> cs.Function:
        x, *_, f, g, given = self.statement.symbols
        forces = type(x).sym("forces", g.numel())
        slope = cs.gradient(f + cs.dot(forces, g), x)
        return cs.Function("lagrangian", [x, given, forces], [cs.densify(slope), cs.densify(g)])


@lru_cache(maxsize=32)
def _compiled(statement: _Statement) -> _Compiled:
    """One statement serves many data sets: it is compiled once."""
    return _Compiled(statement)


@dataclass(frozen=True, eq=False)
class Mapped:
    """Compiled functions of a problem, ready to be mapped over its rows."""

    problem: Problem

    @cached_property
    def _compiled(self) -> _Compiled:
        p = self.problem
        return _compiled(
            _Statement(p.x, p.row, p.residual, p.shared, p.objective, p.constraints, p.given)
        )

    @cached_property
    def _of_rows(self) -> _Compiled:
        """What the rows alone ask for; whatever else costs may be another."""
        return _compiled(_Statement(self.problem.x, self.problem.row, self.problem.residual))

    def _chunks(self, width: int) -> Iterator[slice]:
        total = len(self.problem.rows)
        size = int(np.clip(CHUNK_NUMBERS // max(width, 1), 1, max(total, 1)))
        for start in range(0, total, size):
            yield slice(start, min(start + size, total))

    def residuals(self, x: ArrayLike) -> Array:
        """Unweighted residuals of every row (N, m)."""
        p = self.problem
        out = np.empty((len(p.rows), p.equations))
        for part in self._chunks(p.equations + p.rows.shape[1]):
            out[part] = over_rows(self._of_rows.residual, p.rows[part], x)[0][:, 0]
        return out

    def white_residuals(self, x: ArrayLike) -> Array:
        """Residuals of every row (N, m), weighted and whitened, as :meth:`whitened` has them."""
        p = self.problem
        r = np.sqrt(p.weights)[:, None] * self.residuals(x)
        return less_foretold(r, np.zeros_like(r[:1]), p.follows) if p.follows.size else r

    def jacobians(self, x: ArrayLike) -> Iterator[tuple[slice, Array, Array]]:
        """Chunks of rows: which, residuals (n, m) and Jacobians (n, m, P)."""
        p = self.problem
        for part in self._chunks(p.size * p.equations + p.rows.shape[1]):
            r, J = over_rows(self._of_rows.both, p.rows[part], x)
            yield part, r[:, 0], J

    def whitened(
        self, x: ArrayLike, groups: Indices | None = None
    ) -> Iterator[tuple[slice, Array, Array]]:
        """Chunks of rows, weighted, and each less what the row before it foretells of its noise.

        A row of another group than the one before it follows none.
        """
        p = self.problem
        root = np.sqrt(p.weights)[:, None]
        follows = _within(p.follows, groups)
        last: tuple[Array, Array] | None = None
        for part, r, J in self.jacobians(x):
            r, J = r * root[part], J * root[part][:, :, None]
            if follows.size:
                ends = last or (np.zeros_like(r[:1]), np.zeros_like(J[:1]))
                last = r[-1:], J[-1:]
                phi = follows[part]
                r, J = less_foretold(r, ends[0], phi), less_foretold(J, ends[1], phi)
            yield part, r, J

    def shared(self, x: ArrayLike) -> tuple[Array, Array]:
        """Residuals (s,) that no row carries and their transposed Jacobian (P, s)."""
        if not self.problem.shared.numel():
            return np.empty(0), np.empty((self.problem.size, 0))
        r, J = self._compiled.shared(np.asarray(x))
        return r.full().ravel(), J.full().reshape(self.problem.size, r.numel())

    def shared_gram(self, x: ArrayLike) -> Gram:
        """Normal equations of what no row carries."""
        r, J = self.shared(x)
        if not len(r):
            return Gram.empty(self.problem.size)
        return Gram(J @ J.T, J @ r, float(r @ r), float(len(r)))

    def grams(
        self, x: ArrayLike, groups: Indices | None = None, *, together: bool = False
    ) -> list[Gram]:
        """Normal equations of each group of rows (0, 1, ...), or of all; shared terms in none."""
        p = self.problem
        labels = np.zeros(len(p.rows), dtype=int) if groups is None or together else groups
        groups_of_rows = int(labels.max(initial=0)) + 1
        matrix = np.zeros((groups_of_rows, p.size, p.size))
        vector, totals = np.zeros((groups_of_rows, p.size)), np.zeros((groups_of_rows, 2))
        for part, r, J in self.whitened(x, groups):
            for g in np.unique(labels[part]):
                rows = labels[part] == g
                b = r[rows].ravel()
                A = (J if rows.all() else J[rows]).reshape(b.size, p.size)
                count = float(p.weights[part][rows].sum()) * p.equations
                if p.counts is not None:
                    count = float(p.weights[part][rows] @ p.counts[part][rows])
                matrix[g] += A.T @ A
                vector[g] += A.T @ b
                totals[g] += float(b @ b), count
        kept = zip(matrix, vector, totals.tolist(), strict=True)
        return [Gram(G, v, square, count) for G, v, (square, count) in kept]

    def curvature_along(self, x: Array, step: Array) -> Array:
        r""":math:`J^T r''` (P,), the residuals' second derivative along a step (P,).

        By differences to either side, which cost next to nothing beside many unknowns' Jacobian.
        """
        here, there, back = (x, x + NEARBY * step, x - NEARBY * step)
        white, shared = (
            (f(there) - 2.0 * f(here) + f(back)) / NEARBY**2
            for f in (self.white_residuals, lambda at: self.shared(at)[0])
        )
        return self._back(x, white) + self.shared(x)[1] @ shared

    def _back(self, x: ArrayLike, white: Array) -> Array:
        """:math:`J^T w` (P,) of whitened rows w (N, m), in one sweep back through every row."""
        p = self.problem
        back = np.sqrt(p.weights)[:, None] * back_to_rows(white, p.follows)
        rows, vector = np.hstack([p.rows, back]), np.zeros(p.size)
        for part in self._chunks(p.size + rows.shape[1]):
            vector += over_rows(self._of_rows.pulled, rows[part], x)[0].sum(axis=(0, 1))
        return vector

    def gram(self, x: ArrayLike, groups: Indices | None = None) -> Gram:
        """Normal equations of all rows, whitened group by group, and of the shared residuals."""
        return self.shared_gram(x) + self.grams(x, groups, together=True)[0]

    def cost(self, x: ArrayLike) -> float:
        """What is to be least at x: half the weighted sum of squares, and f."""
        s, _ = self.shared(x)
        half = 0.5 * float(np.sum(self.white_residuals(x) ** 2) + s @ s)
        return half + self.objective(x)[0]

    def objective(self, x: ArrayLike) -> tuple[float, Array]:
        """F and its gradient (P,) at x; zero where there is none."""
        p = self.problem
        if not p.has_objective:
            return 0.0, np.zeros(p.size)
        f, slope = self._compiled.objective(np.asarray(x), p.data)
        return float(f), slope.full().ravel()

    def gradient(self, x: ArrayLike) -> Array:
        """Gradient (P,) of :meth:`cost`."""
        return self.gram(x).vector + self.objective(x)[1]

    def bend(self, x: ArrayLike) -> Array:
        """Hessian (P, P) of f at x; zero where there is none."""
        p = self.problem
        if not p.has_objective:
            return np.zeros((p.size, p.size))
        return np.asarray(self._compiled.bend(np.asarray(x), p.data).full())

    def constraints(self, x: ArrayLike) -> Array:
        """G (c,) at x."""
        found: Array = self._compiled.constraints(np.asarray(x), self.problem.data).full().ravel()
        return found

    def slopes(self, x: ArrayLike) -> Array:
        """Jacobian (c, P) of g at x."""
        found: Array = self._compiled.slopes(np.asarray(x), self.problem.data).full()
        return found

    def lagrangian(self, x: ArrayLike, multipliers: Array) -> tuple[Array, Array]:
        """Gradient (P,) of the cost with g's multipliers (c,), and g (c,)."""
        slope, g = self._compiled.lagrangian(np.asarray(x), self.problem.data, multipliers)
        squares = self.gram(x).vector if self.problem.has_squares else 0.0
        return slope.full().ravel() + squares, g.full().ravel()

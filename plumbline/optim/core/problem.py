r"""A problem in symbols: residuals of one row, whose rows are data, and whatever else costs.

.. math:: \min_x\ \tfrac12 \sum_{rows} w_k\, |r(x; row_k)|^2 + \tfrac12 |s(x)|^2 + f(x)
          \quad\text{s.t.}\quad l \le x \le u,\ \ g_l \le g(x) \le g_u

Nothing is unrolled over a recording: a solver maps the row's function over the rows in chunks.
Derivatives are exact, by CasADi; a statement whose f and g are a chain of stages may give their
Hessian itself. What solvers compile they compile once a statement: rows, weights, bounds and the
data of f and g are its numbers.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Self

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.evaluate import Array as Array
from plumbline.kinematics.evaluate import Flags as Flags
from plumbline.kinematics.evaluate import Indices as Indices
from plumbline.kinematics.evaluate import Integers as Integers

Symbols = Any  # SX; or MX, where a statement maps its stages. CasADi takes either, its stubs do not


def _none() -> cs.SX:
    return cs.SX(0, 1)


def _empty() -> Array:
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be solved; how is the solver's choice."""

    x: Symbols  #: unknowns (P,)
    names: tuple[str, ...]  #: their names (P)
    lower: Array  #: lower bounds (P,)
    upper: Array  #: upper bounds (P,)
    scale: Array  #: typical sizes (P,), by which solvers measure steps
    residual: cs.SX = field(default_factory=_none)  #: residual of one row (m,), in the row's unit
    row: cs.SX = field(default_factory=_none)  #: symbols of one row's data (k,)
    rows: Array = field(default_factory=lambda: np.empty((0, 0)))  #: data (N, k)
    #: weights of the rows (N,), 1 for all unless given
    weights: Array = field(default_factory=_empty)
    #: correlation (N,) of each row's noise with that of the row before it; none at all unless
    #: given. Solvers that work on normal equations whiten the rows by it.
    follows: Array = field(default_factory=_empty)
    #: residuals (s,) that no row carries, e.g. a known distance
    shared: cs.SX = field(default_factory=_none)
    #: f(x), a number that is no square
    objective: Symbols = field(default_factory=lambda: cs.SX(0))
    constraints: Symbols = field(default_factory=_none)  #: g(x) (c,)
    g_lower: Array = field(default_factory=_empty)  #: lower bounds of g (c,)
    g_upper: Array = field(default_factory=_empty)  #: upper bounds of g (c,)
    given: Symbols = field(default_factory=_none)  #: symbols of the data (d,) of f and g
    data: Array = field(default_factory=_empty)  #: the data (d,)
    #: ``(x, given, sigma, multipliers) -> (P, P)``, the Hessian of ``sigma f + multipliers . g``;
    #: None leaves it to CasADi
    curvature: cs.Function | None = None
    #: how many residuals each row has (N,), where some have fewer than m and the rest are nought
    counts: Array | None = None

    def __post_init__(self) -> None:
        """Refuse contradictory bounds and an objective that is no number; weigh rows alike."""
        for k in np.flatnonzero(self.lower > self.upper)[:1].tolist():
            low, high = self.lower[k], self.upper[k]
            raise PlumblineError(
                f"{self.names[k]}: lower bound {low} exceeds upper bound {high}; swap them"
            )
        if self.objective.shape != (1, 1):
            raise PlumblineError(f"objective: shape {self.objective.shape}, one number expected")
        if not self.weights.size:
            object.__setattr__(self, "weights", np.ones(len(self.rows)))
        if isinstance(self.x, cs.MX):  # what is not stated is of the symbols' kind
            for name in ("shared", "objective", "constraints", "given"):
                if isinstance(getattr(self, name), cs.SX):
                    object.__setattr__(self, name, cs.MX(cs.DM(getattr(self, name))))

    def __repr__(self) -> str:
        shape = f"{len(self.rows)} rows of {self.equations} residuals"
        return f"<Problem: {self.size} unknowns, {shape}, {self.g_lower.size} constraints>"

    @property
    def size(self) -> int:
        """Number of unknowns P."""
        return len(self.names)

    @property
    def equations(self) -> int:
        """Number of residuals of one row, m."""
        return int(self.residual.numel())

    @property
    def has_objective(self) -> bool:
        """Whether there is an f."""
        return not self.objective.is_constant()

    @property
    def has_squares(self) -> bool:
        """Whether there are residuals."""
        return bool(len(self.rows) or self.shared.numel())

    @property
    def parts(self) -> dict[str, int]:
        """How much of what a solver must be able to take there is in it."""
        bounded = np.isfinite(self.lower) | np.isfinite(self.upper)
        return {
            "bounds": int(bounded.sum()),
            "constraints": int(self.constraints.numel()),
            "objective": int(self.has_objective),
            "rows": len(self.rows) + int(self.shared.numel()),
        }

    def on(self, rows: Array, weights: Array | None = None) -> Self:
        """The same statement on other rows (N, k), which do not follow each other."""
        unit = np.ones(len(rows)) if weights is None else weights
        return replace(self, rows=rows, weights=unit, follows=_empty(), counts=None)

    @property
    def freedom(self) -> int | Array:
        """How many residuals a row has: m, or each row's own (N,)."""
        return self.equations if self.counts is None else self.counts

    def part(self, kept: Flags) -> Self:
        """The same statement on some of its rows (N,); a row whose predecessor is gone has none."""
        some = self.on(self.rows[kept], self.weights[kept])
        counts = None if self.counts is None else self.counts[kept]
        some = replace(some, counts=counts)
        if not self.follows.size:
            return some
        before = np.concatenate([[False], kept[:-1]])
        return replace(some, follows=np.where(before, self.follows, 0.0)[kept])

r"""A least-squares problem in symbols, stated for one row; the rows are data.

.. math:: \min_x\ \tfrac12 \sum_{rows} w_k\, |r(x; row_k)|^2 + \tfrac12 |s(x)|^2
          \quad\text{s.t.}\quad l \le x \le u,\ \ g_l \le g(x) \le g_u

Nothing is unrolled over a recording: a solver maps the row's function over the rows in chunks.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be solved; how is the solver's choice.

    Attributes:
        x: Unknowns (P,).
        names: Their names (P).
        lower: Lower bounds (P,).
        upper: Upper bounds (P,).
        scale: Typical sizes (P,), by which solvers measure steps.
        residual: Residual of one row (m,), in the row's unit.
        row: Symbols of one row's data (k,).
        rows: Data (N, k).
        weights: Weights of the rows (N,), 1 for all unless given.
        shared: Residuals (s,) that no row carries, e.g. a known distance.
        constraints: g(x) (c,).
        g_lower: Lower bounds of g (c,).
        g_upper: Upper bounds of g (c,).
    """

    x: cs.SX
    names: tuple[str, ...]
    lower: Array
    upper: Array
    scale: Array
    residual: cs.SX
    row: cs.SX
    rows: Array
    weights: Array
    shared: cs.SX = field(default_factory=lambda: cs.SX(0, 1))
    constraints: cs.SX = field(default_factory=lambda: cs.SX(0, 1))
    g_lower: Array = field(default_factory=lambda: np.empty(0))
    g_upper: Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Refuse bounds that contradict each other."""
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if low > high:
                raise ValueError(f"{name}: lower bound {low} exceeds upper bound {high}; swap them")

    def __repr__(self) -> str:
        """Its shape: unknowns, rows, residuals a row."""
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

    def on(self, rows: Array, weights: Array | None = None) -> Problem:
        """The same statement on other rows (N, k)."""
        unit = np.ones(len(rows)) if weights is None else weights
        return replace(self, rows=rows, weights=unit)

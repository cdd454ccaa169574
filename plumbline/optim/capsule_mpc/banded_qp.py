r"""An interior point for a chain of stages: the real-time solver.

The program is :class:`plumbline.optim.capsule_mpc.linearised.StageQp`. A row and its slack are
eliminated together, so that neither rows nor slacks enlarge the system: with slack s, its
multiplier :math:`\rho - \lambda`, and t = G x + s - h,

.. math:: w = 1 / (t / \lambda + s / (\rho - \lambda)), \qquad
          (H + A^T W A)\, \Delta x = -r_{dual} + A^T W q

Steps couple neighbouring stages group by group, so the matrix has half bandwidth b = n + s - 1 with
groups of s states, or b = 2n where changes of steps cost something, and its Cholesky factor costs
:math:`p\, n \cdot b(b + 1)/2` multiplications: nothing is condensed, and cost grows with p.
Predictor and corrector share the factor (Mehrotra 1992, SIAM J. Optim. 2(4)). The program always
has a solution: rows are soft, and standing still keeps the speed limits.

The method is written in C, ``banded_qp.c``, compiled at first use; where there is no compiler, a
solver that CasADi brings takes its place (:mod:`.library_qp`).
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.capsule_mpc.compiled import first_line, library, say_not_compiled
from plumbline.optim.capsule_mpc.library_qp import LibraryQp
from plumbline.optim.capsule_mpc.linearised import QpPath, StageQp
from plumbline.optim.core.problem import Array

QUICK = ("-O3", "-funroll-loops", "-fno-math-errno", "-fno-trapping-math")


@cache
def _native() -> Any:
    source = (resources.files("plumbline.optim.capsule_mpc") / "banded_qp.c").read_text(
        encoding="utf-8"
    )
    made = library(source, "banded_qp", QUICK)
    if made is None:
        return None
    try:
        found = ctypes.CDLL(str(made))
    except OSError as error:
        say_not_compiled(first_line(error))
        return None
    found.banded_qp_space.restype = ctypes.c_long
    pointer, number = ctypes.c_void_p, ctypes.c_double
    found.banded_qp_turned.argtypes = (
        [ctypes.c_int] * 3 + [pointer] * 7 + [number] * 4 + [ctypes.c_int] + [pointer] * 7
    )
    return found


def native() -> bool:
    """Whether the compiled solver is there."""
    return _native() is not None


@dataclass(frozen=True)
class BandedQp:
    """Options of the solver."""

    max_iterations: int = 50  # iterations at most
    # of complementarity and stationarity [mm^2]; of the rows, a hundredth [mm]
    tolerance: float = 1e-3
    compiled: bool = True  # whether to use it; else, or where it is not there, a library's

    def prepare(self) -> None:
        """Compile what the first call would otherwise wait for."""
        if self.compiled:
            native()

    def solve(self, qp: StageQp, start: Array) -> QpPath:
        """Solve from a path (p, n)."""
        if not (self.compiled and native()):
            return LibraryQp().solve(qp, start)
        p, n = qp.g.shape
        rows = qp.h.shape[1]
        solver = _native()
        x = np.array(start, dtype=float)
        slack, multiplier = np.empty((p, rows)), np.empty((p, rows))
        work = np.empty(solver.banded_qp_space(p, n, p * rows))
        kept = np.empty(p + 1 + p * rows, dtype=np.int32)
        turn, group = _turned(qp)
        given = [qp.H, qp.g, qp.x0, qp.move, qp.step, qp.G, qp.h]
        arrays = [np.ascontiguousarray(a, dtype=float) for a in given]
        count = solver.banded_qp_turned(
            p,
            n,
            rows,
            *(a.ctypes.data for a in arrays),
            qp.penalty,
            qp.effort,
            qp.smooth,
            self.tolerance,
            self.max_iterations,
            *(a.ctypes.data for a in (x, slack, multiplier, work, kept)),
            *(None if a is None else a.ctypes.data for a in (turn, group)),
        )
        return QpPath(x, slack, multiplier, count >= 0, abs(count))


def _turned(qp: StageQp) -> tuple[Array | None, NDArray[np.int32] | None]:
    """Turns, and begin and end (2, n) of every state's group."""
    if qp.turn is None:
        return None, None
    ends = np.cumsum(qp.groups)
    sizes = np.asarray(qp.groups)
    bounds = np.repeat(np.stack([ends - sizes, ends]), sizes, axis=1)
    return np.ascontiguousarray(qp.turn), np.ascontiguousarray(bounds, dtype=np.int32)

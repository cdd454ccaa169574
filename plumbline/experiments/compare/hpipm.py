r"""HPIPM asked directly: the same programs, posed as it wants them, beside the banded solver.

Through CasADi's interface a slack is a control, so that a stage of six states has as many controls
as rows. HPIPM knows soft rows natively and eliminates their slacks. Here it is asked through its
own functions, in the library that CasADi brings: states x, and the step before where changes of
steps cost something; controls are steps; the first state is eliminated; rows are soft from below,
and only those that are present are there at all. What is timed is the solver alone, data in place:
HPIPM's ``d_ocp_qp_ipm_solve``, and ``BandedQp.solve``, which hands its arrays to ``banded_qp.c``.
"""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np

from plumbline.experiments.console.measured import timed
from plumbline.optim.capsule_mpc.linearised import QpPath, StageQp
from plumbline.optim.capsule_mpc.planning import BandedQp
from plumbline.optim.core.problem import Array

FAR = 1e6  # [mm] of a bound that is masked
SPEED = 1  # HPIPM's mode: relative interior point, for speed
TOLERANCES = {"stat": 1e-3, "comp": 1e-3, "ineq": 1e-5, "eq": 1e-5}  # those of BandedQp()
MOST, MU0 = 50, 100.0  # iterations; the barrier that it begins with, tried from 1 to 1e4
REPEATS = 5  # the quickest of which counts: anything else on the machine can only add


def hpipm_library() -> ctypes.CDLL | None:
    """HPIPM as CasADi brings it; None where it does not."""
    found = sorted(Path(cs.__file__).parent.glob("*hpipm.*"))
    own = [path for path in found if "casadi" not in path.name]
    try:
        library = ctypes.CDLL(str(own[0]))
        _ = library.d_ocp_qp_ipm_solve
    except (IndexError, OSError, AttributeError):
        return None
    return library


class Hpipm:
    """HPIPM for programs of one size."""

    def __init__(self, library: ctypes.CDLL, n: int, rows: Sequence[int], kept: bool) -> None:
        """Reserve all memory: for stages of n states with so many soft rows each."""
        p = len(rows)
        self.c, self.p, self.n, self.rows, self.kept = library, p, n, rows, kept
        self._memory: list[Any] = []
        states = 2 * n if kept else n
        sizes = [[0] + [states] * p, [n] * p + [0], [0] * (p + 1), [n] * p + [0]]
        sizes += [[0, *rows], [0, *rows]]
        self.dim = self._make("dim", p)
        library.d_ocp_qp_dim_set_all(*((ctypes.c_int * (p + 1))(*size) for size in sizes), self.dim)
        self.qp, self.sol = self._make("", self.dim), self._make("sol", self.dim)
        self.arg = self._make("ipm_arg", self.dim)
        library.d_ocp_qp_ipm_arg_set_default(SPEED, self.arg)
        library.d_ocp_qp_ipm_arg_set_iter_max(ctypes.byref(ctypes.c_int(MOST)), self.arg)
        library.d_ocp_qp_ipm_arg_set_mu0(ctypes.byref(ctypes.c_double(MU0)), self.arg)
        for name, value in TOLERANCES.items():
            set_tolerance = getattr(library, f"d_ocp_qp_ipm_arg_set_tol_{name}")
            set_tolerance(ctypes.byref(ctypes.c_double(value)), self.arg)
        self.work = self._make("ipm_ws", self.dim, self.arg)
        self._constants()

    def _make(self, name: str, *of: Any) -> Any:
        """A structure of HPIPM's, and the memory behind it."""
        stem = f"d_ocp_qp_{name}_" if name else "d_ocp_qp_"
        sizes = [getattr(self.c, stem + what) for what in ("strsize", "memsize")]
        for size in sizes:
            size.restype = ctypes.c_size_t
        own = ctypes.create_string_buffer(sizes[0]())
        memory = ctypes.create_string_buffer(sizes[1](*of) + 64)
        getattr(self.c, stem + "create")(*of, own, memory)
        self._memory += [own, memory]
        return own

    def _set(self, name: str, stage: int, values: Any, kind: type = float) -> None:
        dtype = np.int32 if kind is int else np.float64
        array = np.asfortranarray(values, dtype=dtype)  # HPIPM counts by columns
        self.c.d_ocp_qp_set(name.encode(), stage, ctypes.c_void_p(array.ctypes.data), self.qp)

    def _constants(self) -> None:
        n, eye = self.n, np.eye(self.n)
        for k in range(self.p):
            if k:
                states = 2 * n if self.kept else n
                A = np.zeros((states, states))
                A[:n, :n] = eye
                self._set("A", k, A)
            self._set("idxbu", k, np.arange(n), int)
        for k, rows in enumerate(self.rows, start=1):
            if rows:  # from above they are bounded by nothing
                bounds = n if k < self.p else 0  # they are counted first
                self._set("idxs", k, bounds + np.arange(rows), int)
                self._set("ug", k, np.full(rows, FAR))
                self._set("ug_mask", k, np.zeros(rows))

    def load(self, qp: StageQp) -> None:
        """Put the numbers of a program in place."""
        n, p = self.n, self.p
        present, turn = qp.present, np.broadcast_to(np.eye(n), (p, n, n))
        turn = turn if qp.turn is None else qp.turn  # controls are turned steps
        weight, cross = 2 * (qp.effort + qp.smooth), 2 * qp.smooth
        for k in range(p):
            self._set("R", k, weight * np.eye(n))
            self._set("B", k, np.vstack([turn[k].T] * 2) if self.kept else turn[k].T)
            self._set("lbu", k, -qp.step[k])
            self._set("ubu", k, qp.step[k])
        self._set("b", 0, np.concatenate([qp.x0, np.zeros(n)]) if self.kept else qp.x0)
        self._set("r", 0, -cross * turn[0] @ qp.move)
        for k in range(1, p + 1):
            states = 2 * n if self.kept else n
            Q, q = np.zeros((states, states)), np.zeros(states)
            Q[:n, :n], q[:n] = qp.H[k - 1], qp.g[k - 1]
            if self.kept and k < p:
                Q[n:, n:] = cross * np.eye(n)
                self._set("S", k, np.hstack([np.zeros((n, n)), -cross * turn[k]]))
            self._set("Q", k, Q)
            self._set("q", k, q)
            rows = self.rows[k - 1]
            if rows:
                C = np.zeros((rows, states))
                C[:, :n] = qp.G[k - 1, present[k - 1]]
                self._set("C", k, C)
                self._set("lg", k, qp.h[k - 1, present[k - 1]])
                self._set("zl", k, np.full(rows, qp.penalty))
                self._set("zu", k, np.full(rows, qp.penalty))

    def solve(self) -> tuple[bool, int]:
        """Solve what was loaded; whether it converged, and in how many iterations."""
        self.c.d_ocp_qp_ipm_solve(self.qp, self.sol, self.arg, self.work)
        status, count = ctypes.c_int(), ctypes.c_int()
        self.c.d_ocp_qp_ipm_get_status(self.work, ctypes.byref(status))
        self.c.d_ocp_qp_ipm_get_iter(self.work, ctypes.byref(count))
        return status.value == 0, count.value

    def path(self) -> Array:
        """The states (p, n) of the last solution."""
        out = np.empty((self.p, 2 * self.n if self.kept else self.n))
        for k in range(self.p):
            self.c.d_ocp_qp_sol_get_x(k + 1, self.sol, ctypes.c_void_p(out[k].ctypes.data))
        return out[:, : self.n].copy()


@dataclass(frozen=True)
class Recording:
    """A solver that keeps every program it is given, with the path that it began with."""

    kept: list[tuple[StageQp, Array]]

    def solve(self, qp: StageQp, start: Array) -> QpPath:
        """Solve from a path (p, n)."""
        self.kept.append((qp, start.copy()))
        return BandedQp().solve(qp, start)


@dataclass(frozen=True)
class Race:
    """Both solvers on the same programs."""

    banded: tuple[float, float]  # median and 99th percentile of the banded solver [ms]
    hpipm: tuple[float, float]  # the same of HPIPM with native soft rows [ms]
    gain: float  # median of the ratio, program by program
    apart: float  # largest difference of the paths [mm]
    solved: float  # share of the programs that HPIPM solved
    iterations: tuple[float, float]  # mean numbers of iterations, ours and HPIPM's


def race(programs: Sequence[tuple[StageQp, Array]]) -> Race | None:
    """Solve programs by both; None where this CasADi brings no HPIPM."""
    library = hpipm_library()
    if library is None:
        return None
    times, apart, solved, counts = [], 0.0, 0, []
    for qp, start in programs:
        rows = [int(count) for count in qp.present.sum(axis=1)]
        other = Hpipm(library, len(qp.x0), rows, qp.smooth > 0.0)
        other.load(qp)
        ours = BandedQp().solve(qp, start)
        own = min(timed(partial(BandedQp().solve, qp, start), REPEATS)[1])
        theirs = min(timed(other.solve, REPEATS)[1])
        good, count = other.solve()
        times.append((own, theirs))
        counts.append((ours.iterations, count))
        solved += good
        apart = max(apart, float(np.abs(other.path() - ours.x).max()))
    both = 1e3 * np.array(times)
    banded, hpipm = (np.percentile(column, [50.0, 99.0]) for column in both.T)
    return Race(
        (float(banded[0]), float(banded[1])),
        (float(hpipm[0]), float(hpipm[1])),
        float(np.median(both[:, 1] / both[:, 0])),
        apart,
        solved / len(programs),
        (float(np.mean([c[0] for c in counts])), float(np.mean([c[1] for c in counts]))),
    )

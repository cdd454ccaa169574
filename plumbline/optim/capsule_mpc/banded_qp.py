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

The method is written in C, ``banded_qp.c``, compiled at first use, and again in NumPy, where there
is no compiler; a test holds the two together.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from plumbline.optim.capsule_mpc.compiled import first_line, library, say_not_compiled
from plumbline.optim.capsule_mpc.linearised import StageQp

Array = NDArray[np.float64]
QUICK = ("-O3", "-funroll-loops", "-fno-math-errno", "-fno-trapping-math")
ROOM = 0.1  # [mm] that every slack has at the start; the same in banded_qp.c


@dataclass(frozen=True)
class QpPath:
    """What a solver of the program gives."""

    x: Array  # the path (p, n)
    slack: Array  # slack (p, m) of every row [mm]
    multiplier: Array  # multiplier (p, m) of every row
    solved: bool  # whether it converged
    iterations: int  # how many it took


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
    compiled: bool = True  # whether to use the compiled one, where it is there

    def prepare(self) -> None:
        """Compile what the first call would otherwise wait for."""
        if self.compiled:
            native()

    def solve(self, qp: StageQp, start: Array) -> QpPath:
        """Solve from a path (p, n)."""
        if self.compiled and native():
            return self._solve_native(qp, start)
        return _Plain(qp).solve(start, self.max_iterations, self.tolerance)

    def _solve_native(self, qp: StageQp, start: Array) -> QpPath:
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


class _Plain:
    """The same arithmetic in NumPy; kept rows are padded to the most that any stage keeps."""

    def __init__(self, qp: StageQp) -> None:
        self.qp = qp
        self.p, self.n = qp.g.shape
        self.kept = qp.present
        self.rows = int(self.kept.sum())
        self.stage = np.nonzero(self.kept)[0]
        self.G, self.h = qp.G[self.kept], qp.h[self.kept]
        first = np.zeros((self.p, self.n))
        first[0] = qp.x0
        self.first = first
        self.turn = np.broadcast_to(np.eye(self.n), qp.H.shape) if qp.turn is None else qp.turn
        begun = self.turned(first)
        self.b = np.concatenate([-(qp.step + begun).ravel(), -(qp.step - begun).ravel(), self.h])

    def moves(self, z: Array) -> Array:
        """Differences (p, n) of consecutive stages, x0 left out."""
        return np.diff(z, axis=0, prepend=0.0)

    def turned(self, moves: Array) -> Array:
        """Q of every stage times its move (p, n)."""
        return np.matmul(self.turn, moves[:, :, None])[:, :, 0]

    def multiply(self, z: Array) -> Array:
        """A z."""
        moves = self.turned(self.moves(z)).ravel()
        return np.concatenate([-moves, moves, np.vecdot(self.G, z[self.stage])])

    def transposed(self, y: Array) -> Array:
        """A' y, as (p, n)."""
        N = self.p * self.n
        force = (y[N : 2 * N] - y[:N]).reshape(self.p, 1, self.n)
        out = self.gathered(np.matmul(force, self.turn)[:, 0])
        np.add.at(out, self.stage, self.G * y[2 * N :, None])
        return out

    def gathered(self, force: Array) -> Array:
        """Transpose of :meth:`moves`."""
        out = force.copy()
        out[:-1] -= force[1:]
        return out

    def band(self, w: Array) -> Array:
        """Lower band (2 n + 1, p n) of H + A' W A, as SciPy stores it."""
        p, n, N, smooth = self.p, self.n, self.p * self.n, 2 * self.qp.smooth
        blocks = self.qp.H.copy()
        outer = (self.G * w[2 * N :, None])[:, :, None] * self.G[:, None, :]
        np.add.at(blocks, self.stage, outer)
        limit = (w[:N] + w[N : 2 * N]).reshape(p, n, 1)
        own = np.matmul(self.turn.transpose(0, 2, 1), limit * self.turn)
        diagonal = np.arange(n)
        own[:, diagonal, diagonal] += 2 * self.qp.effort
        blocks += own
        blocks[:-1] += own[1:]
        blocks[:, diagonal, diagonal] += smooth
        blocks[:-1, diagonal, diagonal] += 4 * smooth
        blocks[:-2, diagonal, diagonal] += smooth
        before = own.copy()
        before[:, diagonal, diagonal] += 2 * smooth
        before[:-1, diagonal, diagonal] += 2 * smooth
        out = np.zeros((2 * n + 1, N))
        for i in range(n):
            for j in range(n):
                if i >= j:
                    out[i - j, j::n] = blocks[:, i, j]
                if before[:, i, j].any():
                    out[n + i - j, j : N - n : n] -= before[1:, i, j]
        out[2 * n, : max(N - 2 * n, 0)] = smooth
        return out

    def gradient(self, z: Array, dual: Array) -> Array:
        """Gradient (p, n) of the Lagrangian."""
        qp = self.qp
        moves = self.moves(z) - self.first
        change = 2 * qp.smooth * np.diff(moves, axis=0, prepend=qp.move[None])
        force = 2 * qp.effort * moves + self.gathered(change)
        bent = np.matmul(qp.H, z[:, :, None])[:, :, 0]
        return bent + qp.g + self.gathered(force) - self.transposed(dual)

    def begin(self, z: Array) -> tuple[Array, Array]:
        """Slacks and multipliers to start with."""
        N = 2 * self.p * self.n
        gap = self.multiply(z) - self.b
        T = np.concatenate([np.maximum(gap, ROOM), np.maximum(-gap[N:], 0.0) + ROOM])
        L = 1.0 / T
        L[N : N + self.rows] = np.minimum(L[N : N + self.rows], self.qp.penalty / 2)
        L[N + self.rows :] = self.qp.penalty - L[N : N + self.rows]
        return T, L

    def solve(self, start: Array, most: int, tolerance: float) -> QpPath:
        """Iterate from a path."""
        N, M = 2 * self.p * self.n, 2 * self.p * self.n + self.rows
        z = np.array(start, dtype=float)
        T, L = self.begin(z)
        for iteration in range(most):
            primal = self.multiply(z) - self.b - T[:M]
            primal[N:] += T[M:]
            dual = self.gradient(z, L[:M])
            mu = float(T @ L) / len(T)
            worst = np.array([mu, 100 * np.abs(primal).max(), np.abs(dual).max()])
            if not (worst < 1e30).all():
                return self.result(z, T, L, False, iteration + 1)
            if (worst < tolerance).all():
                return self.result(z, T, L, True, iteration)
            try:
                dz, dT, dL = self.direction(T, L, primal, dual, mu)
            except np.linalg.LinAlgError:
                return self.result(z, T, L, False, iteration + 1)
            length = _length(T, dT, L, dL)
            length *= 0.99 if length < 1.0 else 1.0
            z, T, L = z + length * dz, T + length * dT, L + length * dL
        return self.result(z, T, L, False, most + 1)

    def direction(
        self, T: Array, L: Array, primal: Array, dual: Array, mu: float
    ) -> tuple[Array, Array, Array]:
        """Predictor, then corrector."""
        N, M = 2 * self.p * self.n, 2 * self.p * self.n + self.rows
        R = T / L
        compliance = R[:M].copy()
        compliance[N:] += R[M:]
        w = 1.0 / compliance
        band = self.band(w)
        c = -T
        for corrected in (False, True):
            q = c[:M] - primal
            q[N:] -= c[M:]
            side = self.transposed(w * q) - dual
            dz = solveh_banded(band, side.ravel(), lower=True).reshape(self.p, self.n)
            y = w * (q - self.multiply(dz))
            dL = np.concatenate([y, -y[N:]])
            dT = c - R * dL
            if corrected:
                break
            length = _length(T, dT, L, dL)
            ahead = float((T + length * dT) @ (L + length * dL)) / len(T)
            c = ((ahead / mu) ** 3 * mu - dT * dL) / L - T
        return dz, dT, dL

    def result(self, z: Array, T: Array, L: Array, solved: bool, iterations: int) -> QpPath:
        """Slack and multipliers at the places of their rows."""
        N, M = 2 * self.p * self.n, 2 * self.p * self.n + self.rows
        slack, multiplier = np.zeros(self.kept.shape), np.zeros(self.kept.shape)
        slack[self.kept], multiplier[self.kept] = T[M:], L[N:M]
        return QpPath(z, slack, multiplier, solved, iterations)


def _length(T: Array, dT: Array, L: Array, dL: Array) -> float:
    """The longest step, at most 1, that keeps T and L positive."""
    share = min(float((dT / T).min()), float((dL / L).min()), -1.0)
    return -1.0 / share

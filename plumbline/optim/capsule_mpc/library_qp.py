r"""The same program through a solver of quadratic programs that CasADi brings: piqp, hpipm, daqp...

Unknowns stand stage by stage, :math:`(u_0), (x_1, s_1, u_1), \ldots, (x_p, s_p)` in the order that
hpipm looks for, with the dynamics as equations between the stages,

.. math:: x_{k+1} = x_k + \Delta_k, \qquad |\Delta_k| \le step_k

and one slack for each row. Where changes of steps cost something, the step before is a state too,
:math:`y_{k+1} = \Delta_k`, so that stages stay apart. Absent rows are left out here too: those that
are present move to the front, and the program is built for the next power of two of the most that
any stage holds. HPIPM takes an infinite bound for a number: it is told a finite one, beyond which
it drops the row.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Self

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc.constants import ABSENT, COMES, CURVATURE, DROPPED, INFINITE
from plumbline.optim.capsule_mpc.linearised import QpPath, StageQp
from plumbline.optim.core.problem import Array, Indices

OPTIONS: dict[str, dict[str, Any]] = {
    "piqp": {},
    "hpipm": {"inf": INFINITE, "hpipm": {"iter_max": 50}},
    "daqp": {},
    "osqp": {"osqp": {"verbose": False}},
    "qrqp": {"print_iter": False, "print_header": False, "print_info": False},
    "proxqp": {},
    "highs": {},
}


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where everything stands: stage k holds x_k, y_k, then s_k (from 1 on), then d_k.

    Hpipm has no unknowns but states in its last stage, so one follows in which nothing is asked.
    """

    x: Indices  # states (p + 2, n)
    y: Indices  # steps before (p + 2, n), or none (p + 2, 0)
    s: Indices  # slacks (p, m)
    d: Indices  # steps (p + 1, n)
    dynamics: Indices  # equations of the next states (p + 1, n)
    memory: Indices  # equations of the next steps before (p + 1, n), or none
    rows: Indices  # what has the slacks (p, m)

    @classmethod
    def of(cls, p: int, n: int, m: int, kept: bool) -> Self:
        """Of p stages of n states and m rows; ``kept`` if the step before is a state."""
        y, unknowns, equations = n if kept else 0, [], []
        for k in range(p + 2):
            slacks, steps = [("s", m)] * (0 < k <= p), [("d", n)] * (k <= p)
            unknowns += [("x", n), ("y", y), *slacks, *steps]
            if k <= p:
                equations += [("dynamics", n), ("memory", y), *[("rows", m)] * (k > 0)]
        return cls(**_numbers(unknowns), **_numbers(equations))

    @property
    def size(self) -> int:
        return self.x.size + self.y.size + self.s.size + self.d.size


def _numbers(blocks: list[tuple[str, int]]) -> dict[str, Indices]:
    """Numbers of what blocks hold, one behind the other, by the blocks' names (B, size)."""
    found, at = dict[str, list[Indices]](), 0
    for name, size in blocks:
        found.setdefault(name, []).append(np.arange(at, at + size))
        at += size
    return {name: np.array(numbers) for name, numbers in found.items()}


@dataclass(frozen=True, eq=False)
class _Built:
    """A solver, values that never change, and where those that do have their places."""

    solver: cs.Function
    at: _Layout
    hessian: cs.Sparsity
    rows: cs.Sparsity
    h: Array
    a: Array
    h_blocks: Indices  # (p, n, n)
    d_diagonal: Indices  # (p, n)
    y_diagonal: Indices  # (p, n), or none
    crossed: Indices  # (2, p, n) of y with d, or none
    a_rows: Indices  # (p, m, n)


def _patterns(at: _Layout) -> tuple[Array, Array]:
    """Hessian and equations with all that never changes; ``COMES`` where values come and go."""
    H = CURVATURE * np.eye(at.size)
    A = np.zeros((at.dynamics.size + at.memory.size + at.rows.size, at.size))
    x = at.x[1:-1]
    H[x[:, :, None], x[:, None, :]] = A[at.rows[:, :, None], x[:, None, :]] = COMES
    A[at.rows, at.s] = A[at.dynamics, at.x[:-1]] = A[at.dynamics, at.d] = 1.0
    A[at.dynamics, at.x[1:]] = -1.0
    if at.y.size:
        y, d = at.y[:-2], at.d[:-1]
        A[at.memory, at.d], A[at.memory, at.y[1:]] = 1.0, -1.0
        H[y, d] = H[d, y] = COMES
    return H, A


def _numbered(sparsity: cs.Sparsity, shape: tuple[int, ...]) -> Indices:
    """For every element of a matrix, its number among the nonzeros."""
    out = np.full(shape, -1, dtype=np.intp)
    rows, columns = sparsity.get_triplet()
    out[rows, columns] = np.arange(len(rows))
    return out


@lru_cache(maxsize=16)
def _build(plugin: str, p: int, n: int, m: int, kept: bool) -> _Built:
    if not cs.has_conic(plugin):
        raise PlumblineError(
            f"solver: {plugin!r} is not in this CasADi; take 'piqp', 'hpipm', or BandedQp()"
        )
    at = _Layout.of(p, n, m, kept)
    H, A = _patterns(at)
    hessian, rows = (cs.sparsify(cs.DM(M)).sparsity() for M in (H, A))
    options: dict[str, Any] = {**OPTIONS.get(plugin, {}), "error_on_fail": False}
    if plugin == "hpipm":
        states = at.x.shape[1] + at.y.shape[1]
        options |= {"N": p + 1, "nx": [states] * (p + 2), "ng": [0] + [m] * p + [0]}
        options["nu"] = [n] + [m + n] * p + [0]
    solver = cs.conic("qp", plugin, {"h": hessian, "a": rows}, options)
    in_h, in_a = _numbered(hessian, H.shape), _numbered(rows, A.shape)
    x, y, d = at.x[1:-1], at.y[:-2], at.d[:-1]
    crossed = np.stack([in_h[y, d], in_h[d, y]]) if kept else np.zeros((2, p, 0), dtype=np.intp)
    return _Built(
        solver, at, hessian, rows, H[hessian.get_triplet()], A[rows.get_triplet()],
        in_h[x[:, :, None], x[:, None, :]], in_h[d, d], in_h[y, y], crossed,
        in_a[at.rows[:, :, None], x[:, None, :]],
    )  # fmt: skip


@dataclass(frozen=True)
class LibraryQp:
    """Options of the solver."""

    # its name in CasADi: ``"piqp"``, ``"hpipm"``, ``"daqp"``, ``"osqp"``, ``"proxqp"``
    plugin: str = "piqp"

    def solve(self, qp: StageQp, start: Array) -> QpPath:
        """Solve from a path (p, n)."""
        qp = qp.upright
        p, n = qp.g.shape
        if not qp.h.shape[1]:  # the layout needs a row, if one that is absent
            qp = replace(qp, G=np.zeros((p, 1, n)), h=np.full((p, 1), ABSENT))
        if not all(np.isfinite(values).all() for values in (qp.H, qp.g, qp.G, qp.h)):
            nothing = np.zeros(qp.h.shape)  # CasADi raises for a bound that is no number
            return QpPath(start, nothing, nothing, False, 0)
        present = qp.present
        most = int(present.sum(axis=1).max(initial=0))
        m = min(1 << max(most - 1, 0).bit_length(), qp.h.shape[1])
        built = _build(self.plugin, p, n, m, qp.smooth > 0.0)
        chosen = np.argsort(~present, axis=1, kind="stable")[:, :m]
        G = np.take_along_axis(qp.G, chosen[:, :, None], axis=1)
        h = np.take_along_axis(qp.h, chosen, axis=1)
        at = built.at
        found = built.solver(**_values(built, qp, G, h, start))
        values = found["x"].full().ravel()
        duals = np.maximum(-found["lam_a"].full().ravel()[at.rows], 0.0)
        slack, multiplier = np.zeros(qp.h.shape), np.zeros(qp.h.shape)
        np.put_along_axis(slack, chosen, np.maximum(values[at.s], 0.0), axis=1)
        np.put_along_axis(multiplier, chosen, duals, axis=1)
        stats = built.solver.stats()
        solved = bool(stats["success"]) and bool(np.isfinite(values).all())
        return QpPath(
            values[at.x[1:-1]], slack, multiplier, solved, int(stats.get("iter_count", -1))
        )


def _values(built: _Built, qp: StageQp, G: Array, h: Array, start: Array) -> dict[str, Any]:
    """What CasADi's solver is called with."""
    at, x, d = built.at, built.at.x[1:-1], built.at.d[:-1]
    H, A, g = built.h.copy(), built.a.copy(), np.zeros(at.size)
    present = ~(h <= DROPPED)
    H[built.h_blocks] = qp.H
    H[built.d_diagonal] = 2 * (qp.effort + qp.smooth) + CURVATURE
    H[built.y_diagonal], H[built.crossed] = 2 * qp.smooth + CURVATURE, -2 * qp.smooth
    A[built.a_rows] = np.where(present[:, :, None], G, 0.0)
    g[x], g[at.s] = qp.g, qp.penalty
    low, high = np.full(at.size, -INFINITE), np.full(at.size, INFINITE)
    low[at.x[0]] = high[at.x[0]] = qp.x0
    if at.y.size:
        low[at.y[0]] = high[at.y[0]] = qp.move
    low[at.s], low[d], high[d] = 0.0, -qp.step, qp.step
    low[at.d[-1]] = high[at.d[-1]] = 0.0
    below, above = np.zeros(built.rows.size1()), np.zeros(built.rows.size1())
    below[at.rows], above[at.rows] = np.where(present, h, -INFINITE), INFINITE
    first = np.zeros(at.size)
    first[at.x[0]], first[x] = qp.x0, start
    first[d] = np.diff(start, axis=0, prepend=qp.x0[None])
    return {
        "h": cs.DM(built.hessian, H),
        "a": cs.DM(built.rows, A),
        "g": g,
        "lba": below,
        "uba": above,
        "lbx": low,
        "ubx": high,
        "x0": first,
    }

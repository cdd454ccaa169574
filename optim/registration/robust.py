r"""The rigid fit that leaves a shifted marker out, and names it.

For k = 0, 1, ..., ``most`` left-out markers, every choice of k is fitted without them, and the best
one is accepted if the rest agrees with the noise:

.. math:: Q_k \le \chi^2_{3(n-k)-6}(1 - \alpha)

or, where no noise was stated or no choice agrees with it, if leaving one more out would not help
significantly,

.. math:: \frac{(Q_k - Q_{k+1}) / 3}{Q_{k+1} / (3(n-k-1) - 6)} \le
          F_{3,\, 3(n-k-1)-6}(1 - \alpha / K)

with K choices (Baarda 1968, data snooping; all choices are tried, so that one bad marker cannot
mask another). The readings cannot always say which marker moved: out of four in one plane, a shift
square to the plane leaves the same residuals whichever of them it was. What fits nearly as well is
then named, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, fdtri

from optim.problem import Array
from optim.registration.answer import Registers
from optim.registration.condition import condition_of
from optim.registration.least_squares import minimise
from optim.registration.markers import Markers, Noise, rows_of
from optim.registration.method import Fit
from optim.registration.statement import sensitivity

_UNSTATED = (
    "no noise was stated, so that only shifts of many times what the others misfit by would show: "
    "state the CT's resolution and the robot's std"
)
ROUNDING = 1e-24  # squares of markers that agree exactly
LEAST_ANGLE = 5.0  # [deg]: what is kept must hold the rotation


@dataclass(frozen=True, eq=False)
class _Level:
    """All choices of so many left-out markers.

    Attributes:
        left_out: Which markers each choice leaves out (K).
        squares: Whitened squares of the rest (N, K).
        dof: Freedoms of the rest.
    """

    left_out: tuple[tuple[int, ...], ...]
    squares: Array
    dof: int


@dataclass(frozen=True)
class Robust(Registers):
    """The anisotropic fit of the markers that agree with each other.

    Attributes:
        most: Markers left out at most; three always remain.
        alpha: Chance of leaving a good marker out.
        alpha_unstated: The same where no noise was stated: what is left over by four markers or
            five says little of the noise, and a stricter test would see none but gross shifts.
    """

    most: int = 1
    alpha: float = 1e-3
    alpha_unstated: float = 0.02

    name: ClassVar[str] = "robust"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` of the markers that agree, its derivatives, and which moved."""
        levels = self._levels(markers.rows[None], markers.ct)
        depth, choice = (int(v[0]) for v in self._chosen(levels, markers.known))
        out = levels[depth].left_out[choice]
        kept = [k for k in range(len(markers)) if k not in out]
        rest = markers.select(kept)
        T_RC, centre = minimise(rest.rows[None])[0][0], rest.robot.mean(axis=0)
        jacobian = np.zeros((6, len(markers), 6))
        jacobian[:, kept] = sensitivity(rest, T_RC, centre)
        notes = tuple(self._notes(markers, levels, depth, choice))
        return Fit(T_RC, centre, jacobian, tuple(kept), shifted=out, notes=notes)

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: Noise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], all draws with the same noise."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        shape, n = c.shape[:-2], c.shape[-2]
        c, r = c.reshape(-1, n, 3), r.reshape(-1, n, 3)
        first = Markers.of(c[0], r[0], noise)
        rows = rows_of(c, r, first.ct_cov, first.robot_cov)
        T, squares = minimise(rows)
        doubted = np.full(len(rows), True)
        if first.known:
            doubted = squares > chdtri(3 * n - 6, self.alpha)
        if doubted.any():
            T[doubted] = self._left_out(rows[doubted], first)
        return T.reshape(*shape, 4, 4)

    def _left_out(self, rows: Array, first: Markers) -> Array:
        """``T_RC`` (N, 4, 4) of draws (N, n, 18), each without what it leaves out."""
        levels = self._levels(rows, first.ct)
        depth, choice = self._chosen(levels, first.known)
        T = np.empty((len(rows), 4, 4))
        for k, level in enumerate(levels):
            for j, out in enumerate(level.left_out):
                here = (depth == k) & (choice == j)
                if here.any():
                    T[here] = minimise(np.delete(rows[here], list(out), axis=1))[0]
        return T

    def _levels(self, rows: Array, ct: Array) -> list[_Level]:
        """Every choice of 0, 1, ... markers to leave out that keeps the rotation held."""
        n = rows.shape[1]
        deepest = min(self.most, n - 3)
        levels = []
        for k in range(deepest + 1):
            choices = [out for out in combinations(range(n), k) if _held(ct, out)]
            if not choices:
                break
            squares = [minimise(np.delete(rows, list(out), axis=1))[1] for out in choices]
            levels.append(_Level(tuple(choices), np.stack(squares, axis=1), 3 * (n - k) - 6))
        return levels

    def _chosen(self, levels: list[_Level], known: bool) -> tuple[Array, Array]:
        """Depth (N,) and choice (N,) of the first level that is accepted, else the last."""
        best = np.stack([level.squares.min(axis=1) for level in levels])
        choices = np.stack([level.squares.argmin(axis=1) for level in levels])
        enough = np.ones(best.shape, dtype=bool)
        for k, level in enumerate(levels[1:]):
            drop = (best[k] - best[k + 1]) * level.dof
            enough[k] = drop <= 3 * self._limit(level) * best[k + 1] + ROUNDING
        if known:
            limits = [chdtri(level.dof, self.alpha) for level in levels]
            agree = best <= np.array(limits)[:, None]
            enough = np.where(agree.any(axis=0), agree, enough)
        depth = enough.argmax(axis=0)
        return depth, choices[depth, np.arange(len(depth))]

    def _limit(self, level: _Level) -> float:
        """How much one more marker left out may help by chance."""
        return float(fdtri(3, level.dof, 1.0 - self.alpha_unstated / len(level.left_out)))

    def _notes(
        self, markers: Markers, levels: list[_Level], depth: int, choice: int
    ) -> Sequence[str]:
        """Which markers moved, by how much, and what fits nearly as well."""
        if len(markers) == 3:
            return ("three markers cannot show that one moved: give four or more",)
        level = levels[depth]
        out = level.left_out[choice]
        if not out:
            return () if markers.known else (_UNSTATED,)
        kept = [k for k in range(len(markers)) if k not in out]
        T = minimise(markers.select(kept).rows[None])[0][0]
        notes = []
        for k in out:
            off = float(np.linalg.norm(markers.ct[k] @ T[:3, :3].T + T[:3, 3] - markers.robot[k]))
            notes.append(f"marker {markers.labels[k]} moved by {off * 1e3:.3g} mm: left out")
        rivals = self._rivals(markers, level, choice)
        if rivals:
            notes.append(f"it may as well have been {' or '.join(rivals)}: check them")
        return notes

    def _rivals(self, markers: Markers, level: _Level, choice: int) -> list[str]:
        """Other choices that the noise, stated or left over, allows as well."""
        squares = level.squares[0]
        limit = chdtri(level.dof, self.alpha)
        if not markers.known:
            limit = max(squares[choice], 1e-24) * fdtri(level.dof, level.dof, 0.99)
        names = [" and ".join(markers.labels[k] for k in out) for out in level.left_out]
        return [names[j] for j in range(len(names)) if j != choice and squares[j] <= limit]


def _held(ct: Array, out: tuple[int, ...]) -> bool:
    kept = [k for k in range(len(ct)) if k not in out]
    return not out or condition_of(ct[kept]).angle >= LEAST_ANGLE

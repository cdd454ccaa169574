r"""The rigid fit that leaves shifted markers out, and names them.

With :math:`Q_k` the least whitened squares that remain of n markers without some k of them, as many
are left out as the largest k, up to m, whose last step cannot be chance,

.. math:: Q_{k-1} - Q_k > \chi^2_3(1 - \alpha_k), \qquad
          \alpha_k = \frac{\alpha}{m \binom{n}{k}}

(Rosner 1983, Technometrics 25(2): testing from the most down, bad markers cannot mask one another;
Baarda 1968: data snooping). What remains must agree with the stated noise,
:math:`Q_k \le \chi^2_{3(n-k)-6}(1 - \alpha)`. Where it does not, or where none was stated, the
misfits of the rest are the measure:

.. math:: \frac{(Q_{k-1} - Q_k) / 3}{Q_k / (3(n-k) - 6)} > F_{3,\, 3(n-k)-6}(1 - \alpha_k)

Three markers hold a rigid fit, so that m = (n - 3) / 2 bad ones, rounded down, are the most
against which the rest has a majority of its own (Rousseeuw and Leroy 1987, sec. 3.4); of four
markers one is tried all the same. The readings cannot always say which marker moved: out of four in
one plane, a
shift square to the plane leaves the same residuals whichever of them it was. What fits nearly as
well is then named, too, and no error is predicted.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv, chdtri

from plumbline.optim.core.problem import Array
from plumbline.optim.registration.answer import Registers
from plumbline.optim.registration.least_squares import minimise
from plumbline.optim.registration.markers import Markers, Noise, rows_of
from plumbline.optim.registration.method import Fit
from plumbline.optim.registration.statement import sensitivity
from plumbline.optim.registration.trimmed import Choice, Level, levels_of

_UNSTATED = (
    "no noise was stated, so that only shifts of many times what the others misfit by would show: "
    "state the CT's resolution and the robot's std"
)
ROUNDING = 1e-24  # squares of markers that agree exactly
RIVAL = 2.0 * log(1000.0)  # of twice the log-likelihood: choices less than 1000 times as likely


@dataclass(frozen=True)
class Robust(Registers):
    """The anisotropic fit of the markers that agree with each other.

    Attributes:
        most: Markers left out at most, three always remain; (n - 3) / 2 if not given.
        alpha: Chance of leaving a good marker out.
        alpha_unstated: The same where no noise was stated: what is left over by four markers or
            five says little of the noise, and a stricter test would see none but gross shifts.
    """

    most: int | None = None
    alpha: float = 1e-3
    alpha_unstated: float = 0.005

    name: ClassVar[str] = "robust"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` of the markers that agree, its derivatives, and which moved."""
        levels = levels_of(markers.rows, self._most(len(markers)))
        level = levels[self._depth(levels, markers.known)]
        out = level.left_out[0]
        kept = [k for k in range(len(markers)) if k not in out]
        rest = markers.select(kept)
        T_RC, centre = minimise(rest.rows[None])[0][0], rest.robot.mean(axis=0)
        jacobian = np.zeros((6, len(markers), 6))
        jacobian[:, kept] = sensitivity(rest, T_RC, centre)
        rivals = [_names(markers, other) for other in _rivals(level, markers.known)]
        notes = tuple(self._notes(markers, T_RC, out, rivals))
        doubt = "which marker moved cannot be told: check those named" if rivals else ""
        return Fit(T_RC, centre, jacobian, tuple(kept), shifted=out, notes=notes, doubt=doubt)

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: Noise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], all draws with the same noise."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        shape, n = c.shape[:-2], c.shape[-2]
        c, r = c.reshape(-1, n, 3), r.reshape(-1, n, 3)
        first = Markers.of(c[0], r[0], noise)
        rows = rows_of(c, r, first.ct_cov, first.robot_cov)
        T, squares = minimise(rows)
        for i in np.flatnonzero(squares > self._harmless(n, first.known)):
            levels = levels_of(rows[i], self._most(n))
            out = levels[self._depth(levels, first.known)].left_out[0]
            if out:
                T[i] = minimise(np.delete(rows[i], list(out), axis=0)[None])[0][0]
        return T.reshape(*shape, 4, 4)

    def _most(self, n: int) -> int:
        given = max((n - 3) // 2, 1) if self.most is None else self.most
        return max(min(given, n - 3), 0)

    def _harmless(self, n: int, known: bool) -> float:
        """Squares of all n markers from which no step can be steep enough."""
        most = self._most(n)
        if not most:
            return np.inf
        share = self.alpha / (most * n)
        return float(min(chdtri(3, share), chdtri(3 * n - 6, self.alpha))) if known else -1.0

    def _depth(self, levels: list[Level], known: bool) -> int:
        """How many markers are left out."""
        if known:
            depth = self._deepest(levels, known=True)
            if levels[depth].squares[0] <= chdtri(levels[depth].dof, self.alpha):
                return depth
        return self._deepest(levels, known=False)

    def _deepest(self, levels: list[Level], *, known: bool) -> int:
        """The largest number left out whose last step cannot be chance."""
        alpha = self.alpha if known else self.alpha_unstated
        for k in range(len(levels) - 1, 0, -1):
            level, share = levels[k], alpha / ((len(levels) - 1) * levels[k].choices)
            drop = levels[k - 1].squares[0] - level.squares[0]
            if known:
                limit = chdtri(3, share)
            else:
                limit = _steepest(level.dof, share) * level.squares[0] + ROUNDING
            if drop > limit:
                return k
        return 0

    def _notes(self, markers: Markers, T: Array, out: Choice, rivals: list[str]) -> tuple[str, ...]:
        """Which markers moved, by how much, and what fits nearly as well."""
        if len(markers) == 3:
            return ("three markers cannot show that one moved: give four or more",)
        if not out:
            return () if markers.known else (_UNSTATED,)
        off = np.linalg.norm(markers.ct @ T[:3, :3].T + T[:3, 3] - markers.robot, axis=1)
        moved = [
            f"marker {markers.labels[k]} moved by {off[k] * 1e3:.3g} mm: left out" for k in out
        ]
        if rivals:
            moved.append(f"it may as well have been {' or '.join(rivals)}: check them")
        return tuple(moved)


def _steepest(dof: int, share: float) -> float:
    r"""Drop over remaining squares that chance exceeds in a share, :math:`3 F_{3, dof} / dof`.

    By the complement, since a share of 1e-60 is lost beside one.
    """
    if not dof:
        return np.inf
    x = float(betaincinv(dof / 2.0, 1.5, share))
    return (1.0 - x) / x if x else np.inf


def _rivals(level: Level, known: bool) -> list[Choice]:
    """Other choices that are not a thousand times less likely."""
    best, others = level.squares[0], level.squares[1:]
    ratio = (others + ROUNDING) / (best + ROUNDING)
    away = others - best if known else level.dof * np.log(ratio)
    return [out for out, d in zip(level.left_out[1:], away, strict=True) if d <= RIVAL]


def _names(markers: Markers, out: Choice) -> str:
    return " and ".join(markers.labels[k] for k in out)

r"""The rigid fit that leaves shifted markers out, and names them.

With :math:`Q_k` the least whitened squares that remain of n markers without some k of them, as many
are left out as the largest k, up to m, whose last step cannot be chance,

.. math:: \frac{(Q_{k-1} - Q_k) / 3}{(\nu + Q_k) / (\nu + \nu_k)}
          > F_{3,\, \nu + \nu_k}(1 - \alpha_k), \qquad
          \alpha_k = \frac{\alpha}{m \binom{n}{k}}, \qquad \nu_k = 3(n-k) - 6

(Rosner 1983, Technometrics 25(2): testing from the most down, bad markers cannot mask one another;
Baarda 1968: data snooping). The measure is the stated noise, worth :math:`\nu` freedoms, together
with the misfits of the rest. What remains must agree with what was stated,
:math:`Q_k \le \chi^2_{\nu_k}(1 - \alpha)`; where it does not, or where nothing was stated,
:math:`\nu = 0`.

Three markers hold a rigid fit, so that m = (n - 3) / 2 bad ones, rounded down, are the most
against which the rest has a majority of its own (Rousseeuw and Leroy 1987, sec. 3.4); of four
markers one is tried all the same. Out of four in one plane, a shift square to the plane leaves the
same residuals whichever of them it was: what fits nearly as well is then named, too, and no error
is predicted.

The sets of k are those of least trimmed squares (Rousseeuw 1984, J. Am. Stat. Assoc. 79(388)): all
choices where they are few. Otherwise triples give the starts, all of them or a seeded draw, judged
by their n - m smallest squares, and the best are refitted to the markers that they fit best until
those stay the same (Rousseeuw and Van Driessen 2006, Data Min. Knowl. Discov. 12: concentration).
"""

from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import Annotated, ClassVar

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy.special import betaincinv, chdtri

from plumbline.declared import Count, Declared, Range
from plumbline.optim.core.problem import Array, Indices
from plumbline.optim.registration import constants
from plumbline.optim.registration.checks import condition_of
from plumbline.optim.registration.least_squares import Fit, draws, judged_fit, minimise
from plumbline.optim.registration.markers import UPPER, MarkerNoise, Markers
from plumbline.optim.registration.statement import sensitivity
from plumbline.optim.rigid import rigid_match

Choice = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Level:
    """Choices of so many left-out markers, the best first."""

    left_out: tuple[Choice, ...]  # which markers each choice leaves out (K)
    squares: Array  # whitened squares of the rest (K,), ascending
    dof: int  # freedoms of the rest
    choices: int  # how many there were to choose from


def levels_of(rows: Array, most: int) -> list[Level]:
    """Levels of 0, 1, ... up to ``most`` left-out markers of n rows (n, 18)."""
    n = len(rows)
    starts: Array | None = None
    levels = []
    for k in range(most + 1):
        if comb(n, k) <= constants.EVERY:
            choices = list(combinations(range(n), k))
        else:
            starts = _trimmed(rows, most) if starts is None else starts
            choices = _concentrated(rows, starts, k)
        held = [out for out in choices if not out or _holds(rows[_kept(n, out), :3])]
        if not held:
            break
        squares = minimise(rows[np.array([_kept(n, out) for out in held])])[1]
        order = np.argsort(squares, kind="stable")
        left_out = tuple(held[j] for j in order)
        levels.append(Level(left_out, squares[order], 3 * (n - k) - 6, comb(n, k)))
    return levels


def whitened_squares(rows: Array, T: Array) -> Array:
    """Whitened squares (K, n) of markers (n, 18) under poses (K, 4, 4)."""
    A = T[:, None, :3, :3]
    d = (A @ rows[:, :3, None])[..., 0] + T[:, None, :3, 3] - rows[:, 3:6]
    spread = A @ _symmetric(rows[:, 6:12]) @ np.swapaxes(A, -1, -2) + _symmetric(rows[:, 12:18])
    return np.sum(d * np.linalg.solve(spread, d[..., None])[..., 0], axis=-1)


def _trimmed(rows: Array, most: int) -> Array:
    """The best poses (K, 4, 4) by their n - most smallest squares."""
    n, size = len(rows), len(rows) - most
    triples = _triples(n)
    T = rigid_match(rows[triples, :3], rows[triples, 3:6])
    T = T[_smallest_sums(whitened_squares(rows, T), size)[: constants.STARTS]]
    for _ in range(constants.CONCENTRATIONS):
        kept = np.sort(np.argsort(whitened_squares(rows, T), axis=1)[:, :size], axis=1)
        before, T = T, minimise(rows[np.unique(kept, axis=0)])[0]
        if T.shape == before.shape and np.allclose(T, before, rtol=0.0, atol=constants.SETTLED):
            break
    return T[_smallest_sums(whitened_squares(rows, T), size)[: constants.KEPT]]


def _triples(n: int) -> Indices:
    """All triples (K, 3) of n markers, or a draw of them."""
    if comb(n, 3) <= constants.TRIPLES:
        return np.array(list(combinations(range(n), 3)))
    return np.random.default_rng(0).random((constants.TRIPLES, n)).argsort(axis=1)[:, :3]


def _smallest_sums(squares: Array, size: int) -> Indices:
    """Which of some poses have the smallest sums of so many smallest squares (K, n), in order."""
    sums = np.partition(squares, size - 1, axis=1)[:, :size].sum(axis=1)
    return np.argsort(sums, kind="stable")


def _concentrated(rows: Array, T: Array, k: int) -> list[Choice]:
    """Choices of k left-out markers by poses (K, 4, 4), refitted once to the rest."""
    size = len(rows) - k
    kept = np.sort(np.argsort(whitened_squares(rows, T), axis=1)[:, :size], axis=1)
    T = minimise(rows[np.unique(kept, axis=0)])[0]
    worst = np.sort(np.argsort(whitened_squares(rows, T), axis=1)[:, size:], axis=1)
    return [tuple(int(j) for j in out) for out in np.unique(worst, axis=0)]


def _kept(n: int, out: Choice) -> list[int]:
    return [k for k in range(n) if k not in out]


def _holds(ct: Array) -> bool:
    """Whether some triple of points (n, 3) [m] has no angle below the least."""
    spread = np.linalg.svd(ct - ct.mean(axis=0), compute_uv=False)
    aside = np.hypot(spread[1], spread[2]) / np.sqrt(len(ct))
    if aside >= np.sin(np.radians(constants.LEAST_HELD)) * scipy.spatial.distance.pdist(ct).max():
        return True
    return bool(condition_of(ct).angle >= constants.LEAST_HELD)


def _symmetric(upper: Array) -> Array:
    """Matrices (n, 3, 3) of upper triangles (n, 6)."""
    matrices = np.empty((len(upper), 3, 3))
    matrices[:, UPPER[0], UPPER[1]] = upper
    matrices[:, UPPER[1], UPPER[0]] = upper
    return matrices


_UNSTATED = (
    "no noise was stated, so that only shifts of many times what the others misfit by would show: "
    "state the CT's resolution and the robot's std"
)


Chance = Annotated[float, Range(0.0, 1.0, "()")]


@dataclass(frozen=True)
class Robust(Declared):
    """The anisotropic fit of the markers that agree with each other."""

    # markers left out at most, three always remain; (n - 3) / 2 if not given
    most: Count | None = None
    alpha: Chance = constants.ALPHA  # chance of leaving a good marker out
    # the same where no noise was stated: what is left over by four markers or five says little of
    # the noise, and a stricter test would see none but gross shifts
    alpha_unstated: Chance = constants.ALPHA_UNSTATED

    name: ClassVar[str] = "robust"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` of the markers that agree, its derivatives, and which moved."""
        levels = levels_of(markers.rows, self._most(len(markers)))
        level = levels[self._depth(levels, markers.freedoms)]
        out = level.left_out[0]
        kept = [k for k in range(len(markers)) if k not in out]
        rest = markers.select(kept)
        T_RC, centre = minimise(rest.rows[None])[0][0], rest.robot.mean(axis=0)
        jacobian = np.zeros((6, len(markers), 6))
        jacobian[:, kept] = sensitivity(rest, T_RC, centre)
        rivals = [_names(markers, other) for other in _rivals(level, markers.freedoms)]
        notes = tuple(self._notes(markers, T_RC, out, rivals))
        doubt = "which marker moved cannot be told: check those named" if rivals else ""
        ended = judged_fit(rest, T_RC)
        return Fit(
            T_RC, centre, jacobian, tuple(kept),
            shifted=out, notes=notes, doubt=doubt, judged=ended,
        )  # fmt: skip

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], all draws with the same noise."""
        rows, first = draws(ct, robot, noise)
        n = len(first)
        T, squares = minimise(rows)
        for i in np.flatnonzero(squares > self._harmless(n, first.freedoms)):
            levels = levels_of(rows[i], self._most(n))
            out = levels[self._depth(levels, first.freedoms)].left_out[0]
            if out:
                T[i] = minimise(np.delete(rows[i], list(out), axis=0)[None])[0][0]
        return T.reshape(*np.shape(ct)[:-2], 4, 4)

    def _most(self, n: int) -> int:
        given = max((n - constants.FEWEST) // 2, 1) if self.most is None else self.most
        return max(min(given, n - constants.FEWEST), 0)

    def _harmless(self, n: int, stated: float) -> float:
        """Squares of all n markers from which no step can be steep enough."""
        most = self._most(n)
        if not most:
            return np.inf
        steps = [
            _steepest(0.0, 3 * (n - k) - 6, self.alpha / (most * comb(n, k)), stated)
            for k in range(1, most + 1)
        ]
        return float(min(*steps, chdtri(3 * n - 6, self.alpha))) if stated else -1.0

    def _depth(self, levels: list[Level], stated: float) -> int:
        """How many markers are left out; the stated noise is worth so many freedoms."""
        if stated:
            depth = self._deepest(levels, self.alpha, stated)
            if levels[depth].squares[0] <= chdtri(levels[depth].dof, self.alpha):
                return depth
        return self._deepest(levels, self.alpha_unstated, 0.0)

    def _deepest(self, levels: list[Level], alpha: float, stated: float) -> int:
        """The largest number left out whose last step cannot be chance."""
        for k in range(len(levels) - 1, 0, -1):
            level, share = levels[k], alpha / ((len(levels) - 1) * levels[k].choices)
            drop = levels[k - 1].squares[0] - level.squares[0]
            if drop > _steepest(level.squares[0], level.dof, share, stated) + constants.ROUNDING:
                return k
        return 0

    def _notes(self, markers: Markers, T: Array, out: Choice, rivals: list[str]) -> tuple[str, ...]:
        """Which markers moved, by how much, and what fits nearly as well."""
        if len(markers) == constants.FEWEST:
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


def _steepest(squares: float, dof: int, share: float, stated: float) -> float:
    r"""Drop to remaining squares that chance exceeds in a share (1e-60, too), :math:`3 s^2 F`."""
    if np.isinf(stated):
        return float(chdtri(3, share))
    x = float(betaincinv((stated + dof) / 2.0, 1.5, share)) if stated + dof else 0.0
    return (stated + squares) * (1.0 - x) / x if x else np.inf


def _rivals(level: Level, stated: float) -> list[Choice]:
    """Other choices that are not a thousand times less likely, by Student's t."""
    best, others = level.squares[0] + constants.ROUNDING, level.squares[1:] + constants.ROUNDING
    if np.isinf(stated):
        away = others - best
    else:
        away = (stated + level.dof) * np.log((stated + others) / (stated + best))
    return [out for out, d in zip(level.left_out[1:], away, strict=True) if d <= constants.RIVAL]


def _names(markers: Markers, out: Choice) -> str:
    return " and ".join(markers.labels[k] for k in out)

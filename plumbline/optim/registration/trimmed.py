r"""Which markers agree with each other? Sets of k to leave out, every one or the likeliest.

.. math:: \min_{|H| = n - k} \min_{R, t} \sum_{i \in H} |r_i|^2

Least trimmed squares (Rousseeuw 1984, J. Am. Stat. Assoc. 79(388)). Where there are few choices of
k out of n all of them are tried. Otherwise triples give the starts, all of them or a seeded draw,
each judged by the sum of its n - m smallest squares, m being the most that may be left out; the
best are refitted to the markers that they fit best until those stay the same (Rousseeuw and Van
Driessen 2006, Data Min. Knowl. Discov. 12: concentration).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from plumbline.optim.core.problem import Array
from plumbline.optim.registration.condition import condition_of
from plumbline.optim.registration.constants import (
    CONCENTRATIONS,
    EVERY,
    KEPT,
    LEAST_HELD,
    SETTLED,
    STARTS,
    TRIPLES,
)
from plumbline.optim.registration.least_squares import minimise
from plumbline.optim.registration.markers import UPPER
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
        if comb(n, k) <= EVERY:
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
    squares: Array = np.sum(d * np.linalg.solve(spread, d[..., None])[..., 0], axis=-1)
    return squares


def _trimmed(rows: Array, most: int) -> Array:
    """The best poses (K, 4, 4) by their n - most smallest squares."""
    n, size = len(rows), len(rows) - most
    triples = _triples(n)
    T = rigid_match(rows[triples, :3], rows[triples, 3:6])
    T = T[_smallest_sums(whitened_squares(rows, T), size)[:STARTS]]
    for _ in range(CONCENTRATIONS):
        kept = np.sort(np.argsort(whitened_squares(rows, T), axis=1)[:, :size], axis=1)
        before, T = T, minimise(rows[np.unique(kept, axis=0)])[0]
        if T.shape == before.shape and np.allclose(T, before, rtol=0.0, atol=SETTLED):
            break
    return T[_smallest_sums(whitened_squares(rows, T), size)[:KEPT]]


def _triples(n: int) -> NDArray[np.intp]:
    """All triples (K, 3) of n markers, or a draw of them."""
    if comb(n, 3) <= TRIPLES:
        return np.array(list(combinations(range(n), 3)))
    return np.random.default_rng(0).random((TRIPLES, n)).argsort(axis=1)[:, :3]


def _smallest_sums(squares: Array, size: int) -> NDArray[np.intp]:
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
    """Whether some triple of points (n, 3) [m] has no angle below the least.

    Some point is as far from the line of the widest pair as all are from their best line in the
    mean square, which spares looking at triples.
    """
    spread = np.linalg.svd(ct - ct.mean(axis=0), compute_uv=False)
    aside = np.hypot(spread[1], spread[2]) / np.sqrt(len(ct))
    if aside >= np.sin(np.radians(LEAST_HELD)) * pdist(ct).max():
        return True
    return bool(condition_of(ct).angle >= LEAST_HELD)


def _symmetric(upper: Array) -> Array:
    """Matrices (n, 3, 3) of upper triangles (n, 6)."""
    matrices = np.empty((len(upper), 3, 3))
    matrices[:, UPPER[0], UPPER[1]] = upper
    matrices[:, UPPER[1], UPPER[0]] = upper
    return matrices

r"""Slips in writing a recording down, each undone, and what a model then leaves of it.

The signs of joints, zeros off by quarters of a turn, swapped columns and joints that count from the
one before are tried in turn. What is
left are the gaps after the best frame F, shift t and, where it is free, tool d, all by squares,

.. math:: \min_{F, t, d} \sum_i |F\,(p_i + R_i d) + t - y_i|^2
"""

from collections.abc import Iterator, Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from plumbline.kinematics.evaluate import Array
from plumbline.optim.recording.constants import FRAME_STEPS, UNTOLD
from plumbline.optim.rigid import best_rotation

TURNED = ("", "90 degrees", "180 degrees", "-90 degrees")


class Slip(NamedTuple):
    """One slip undone."""

    change: str  # what is other, in words
    q: Array  # joint readings (N, n) without it


def signs(q: Array) -> Iterator[Slip]:
    """One sign turned."""
    for j in range(q.shape[1]):
        yield Slip(f"the sign of {named([j])} turned", turned_signs(q, [j]))


def zeros(q: Array, turns: Sequence[bool]) -> Iterator[Slip]:
    """One zero moved by quarters of a turn, of joints that turn."""
    for j, quarter in product(np.flatnonzero(turns).tolist(), (1, 3, 2)):
        change = f"{TURNED[quarter]} added to q{j + 1}"
        yield Slip(change, moved_zero(q, j, quarter))


def swaps(q: Array) -> Iterator[Slip]:
    """Two columns swapped."""
    for i, j in combinations(range(q.shape[1]), 2):
        yield Slip(f"q{i + 1} and q{j + 1} swapped", swapped(q, i, j))


def turned_round(q: Array) -> Iterator[Slip]:
    """All columns in reverse order."""
    yield Slip("the joints in reverse order", q[:, ::-1])


def counted_from_others(q: Array, turns: Sequence[bool]) -> Iterator[Slip]:
    """Joints in a row, each of which counts from where the one before it points, or against it.

    So the drives of parallelograms count, whose links keep their direction.
    """
    for first, last in combinations(range(q.shape[1]), 2):
        rest = range(first + 1, last + 1)
        for by in (-1.0, 1.0) if all(turns[first : last + 1]) else ():
            pairs = ", ".join(f"[{j + 1}, {j}, {by}]" for j in rest)
            other = q.copy()
            other[:, first + 1 : last + 1] += by * q[:, first:last]
            yield Slip(f"couplings = [{pairs}] in [robot]", other)


def turned_signs(q: Array, joints: Sequence[int]) -> Array:
    """Readings (N, n) with the signs of some joints (from 0) turned."""
    return q * np.where(np.isin(np.arange(q.shape[1]), joints), -1.0, 1.0)


def moved_zero(q: Array, joint: int, quarters: int) -> Array:
    """Readings (N, n) with quarters of a turn added to one joint (from 0)."""
    return q + quarters * np.pi / 2 * (np.arange(q.shape[1]) == joint)


def swapped(values: Array, i: int, j: int) -> Array:
    """Values (N, n) with two columns (from 0) swapped."""
    order = np.arange(values.shape[1])
    order[[i, j]] = j, i
    return values[:, order]


def whole_turns(apart: Array) -> Array:
    """How many turns angles (N,) [rad], which are known to a turn alone, are off their middle."""
    middle = np.angle(np.exp(1j * apart).mean())
    return np.asarray(np.round((apart - middle) / (2 * np.pi)))


def named(joints: Sequence[int]) -> str:
    """Joints (from 0) by the names of their columns."""
    return ", ".join(f"q{j + 1}" for j in joints)


def matched(R: Array, p: Array, measured: Array, fit_tool: bool) -> tuple[Array, Array]:
    """The best frame's rotation (3, 3), and measured minus predicted (N, 3) in it [m].

    Args:
        R: Orientations of the tip frame (N, 3, 3).
        p: Predicted tips (N, 3) [m].
        measured: Measured ones (N, 3) [m].
        fit_tool: Whether the tool is free.
    """
    a, y = p - p.mean(axis=0), measured - measured.mean(axis=0)
    inner, tool = R - R.mean(axis=0), np.zeros(3)
    F = best_rotation(a, y)
    for _ in range(FRAME_STEPS if fit_tool else 0):
        v = a + inner @ tool
        J = np.concatenate([-_cross(v), inner], axis=2).reshape(-1, 6)
        step = np.linalg.lstsq(J, (y @ F - v).ravel(), rcond=UNTOLD)[0]
        tool = tool + step[3:]
        F = best_rotation(a + inner @ tool, y)
    return F, y - (a + inner @ tool) @ F.T


def _cross(v: Array) -> Array:
    """Matrices (N, 3, 3) that take the cross products of vectors (N, 3) with another."""
    return np.cross(np.eye(3)[None], v[:, None])

"""Slips of columns undone: what is other in each, in words, and the joint readings without it."""

from collections.abc import Iterator, Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from plumbline.optim.recording.table import Array, Flags

# Words, no measure: what quarters of a turn (90 degrees each) are called, by their number from 0.
QUARTERS = ("", "90 degrees", "180 degrees", "-90 degrees")


class Slip(NamedTuple):
    """One slip undone."""

    change: str  # what is other, in words
    q: Array  # joint readings (N, n) without it


def signs(q: Array) -> Iterator[Slip]:
    """One sign turned."""
    for j in range(q.shape[1]):
        yield Slip(f"the sign of {named([j])} turned", turned_signs(q, [j]))


def zeros(q: Array, turns: Flags) -> Iterator[Slip]:
    """One zero moved by quarters of a turn, of joints that turn."""
    for j, quarter in product(np.flatnonzero(turns).tolist(), (1, 3, 2)):
        change = f"{QUARTERS[quarter]} added to q{j + 1}"
        yield Slip(change, moved_zero(q, j, quarter))


def swaps(q: Array) -> Iterator[Slip]:
    """Two columns swapped."""
    for i, j in combinations(range(q.shape[1]), 2):
        yield Slip(f"q{i + 1} and q{j + 1} swapped", swapped(q, i, j))


def turned_round(q: Array) -> Iterator[Slip]:
    """All columns in reverse order."""
    yield Slip("the joints in reverse order", q[:, ::-1])


def counted_from_others(q: Array, turns: Flags) -> Iterator[Slip]:
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

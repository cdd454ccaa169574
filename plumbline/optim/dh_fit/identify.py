r"""Which parameters the poses can tell, and which only move together.

With J the Jacobian of all misfits, its columns in units of the bounds' half-widths, over the
recorded poses and at readings that the nominal robot would have given (so that noise hides no
dependence),

.. math:: J P = Q R, \qquad J_{held} = J_{kept} C

a QR factorisation with column pivoting (Golub and Van Loan 2013, sec. 5.4.2) keeps a largest set of
independent columns, frame and tool first. A column of C says with what a held parameter moves
together: together with a one in its own place it is a vector of the null space. Then, while a kept
parameter's standard error at the known noise exceeds that of a value anywhere between its bounds,

.. math:: \sigma \sqrt{[(J^T J)^{-1}]_{kk}} > \delta_k / \sqrt 3,

the worst of them is held at its nominal value too: its bounds know more than the data.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Self

import numpy as np

from plumbline.kinematics.link_table import LinkTable
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import enumerated
from plumbline.optim.dh_fit.constants import ABSENT, DEPENDENT, LOST, MOST_POSES, PARTNER
from plumbline.optim.dh_fit.losses import Squares
from plumbline.optim.dh_fit.statement import DHStatement, Pass, Readings, Unknown, state
from plumbline.optim.rigid import some_of


class Why(StrEnum):
    """Why a parameter is held at its nominal value."""

    NO_EFFECT = "no effect"
    TOGETHER = "moves together"
    WEAK = "too weak"


@dataclass(frozen=True)
class Held:
    """A parameter that the poses cannot tell."""

    name: str  # its name
    why: Why  # what is wrong with it
    # names of the free parameters that make up for it, and how far each moves, in its own unit, for
    # one unit of this one
    partners: tuple[tuple[str, float], ...]
    words: str  # the same in a sentence


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What the poses can tell."""

    unknowns: tuple[Unknown, ...]  # all parameters that were asked for (P)
    kept: tuple[int, ...]  # which of them are free, by place
    held: tuple[Held, ...]  # the others, with what they move together with
    rank: int  # numerical rank of the Jacobian
    triangle: Array  # R of the Jacobian (P, P), columns in units of the scales [m]

    @property
    def free(self) -> tuple[Unknown, ...]:
        """The parameters that are free."""
        return tuple(self.unknowns[k] for k in self.kept)

    def weighed(self, noise: float) -> Self:
        """With those held as well that are lost in a noise of one axis, 1 sigma [m]."""
        kept, weak = list(self.kept), {}
        while (worst := _weakest(self.triangle, kept, self.unknowns, noise)) is not None:
            kept.remove(worst)
            name = self.unknowns[worst].name
            weak[worst] = Held(
                name, Why.WEAK, (), f"{name} moves the tip too little in these poses"
            )
        return replace(self, kept=tuple(kept), held=(*self.held, *weak.values()))


def noise_free(
    table: LinkTable,
    tool: Array,
    unknowns: Sequence[Unknown],
    q: Array,
    registration_q: Array | None,
) -> tuple[DHStatement, Readings]:
    """The statement and the readings (N) of a nominal robot whose camera stands in its base."""
    blank = Readings(q, np.eye(3)[np.arange(len(q)) % 3])
    plain = state(table, tool, (), Squares(), readings=blank, registration=None)
    readings = Readings(q, plain.tips(np.empty(0), q))
    registration = None
    if registration_q is not None:
        registration = Readings(registration_q, plain.tips(np.empty(0), registration_q))
    stated = state(table, tool, unknowns, Squares(), readings=readings, registration=registration)
    return stated, readings


def triangle(
    stated: DHStatement, readings: Readings, x: Array, weight: Array | None = None
) -> Array:
    """R (P, P) of the Jacobian of all misfits at x, columns in units of the scales [m].

    Built up chunk by chunk, so that no square of a small singular value is ever taken; ``weight``
    (3, 3) multiplies every row's Jacobian.
    """
    R: Array = np.zeros((0, stated.size))
    for _, J in Pass(stated, readings).jacobians(x):
        J = J if weight is None else weight @ J
        block = (J * stated.scale).reshape(-1, stated.size)
        R = np.asarray(np.linalg.qr(np.vstack([R, block]), mode="r"))
    rows = np.zeros((max(stated.size - len(R), 0), stated.size))
    return np.vstack([R, rows])


def identify(
    table: LinkTable,
    tool: Array,
    unknowns: Sequence[Unknown],
    q: Array,
    registration_q: Array | None = None,
) -> Identifiability:
    """Choose a largest set of parameters that poses (N, n) can tell apart, frame and tool first.

    ``registration_q`` (4, n) are those of the registration points; None if the frame is free.
    """
    some = some_of(len(q), MOST_POSES)
    stated, readings = noise_free(table, tool, unknowns, q[some], registration_q)
    R = triangle(stated, readings, stated.nominal) * np.sqrt(len(q) / len(some))
    first = [k for k, u in enumerate(unknowns) if u.cell is None]
    kept = _independent(R, first)
    shares = np.linalg.lstsq(R[:, kept], R, rcond=None)[0]  # C: every column as a sum of kept ones
    out = [k for k in range(len(unknowns)) if k not in kept]
    held = tuple(_held(k, unknowns, kept, shares[:, k], R) for k in out)
    return Identifiability(tuple(unknowns), tuple(sorted(kept)), held, len(kept), R)


def _independent(R: Array, first: Sequence[int]) -> list[int]:
    """Columns of a largest independent set: those of ``first`` in turn, then by pivoting."""
    left = R.copy()
    sizes = np.linalg.norm(R, axis=0)
    largest = sizes.max(initial=0.0)
    kept: list[int] = []
    waiting = [k for k in range(R.shape[1]) if k not in first]
    while True:
        rest = np.linalg.norm(left, axis=0)
        good = (rest > DEPENDENT * sizes) & (sizes > ABSENT * largest)
        queue = [k for k in first if good[k] and k not in kept]
        if not queue:
            queue = sorted((k for k in waiting if good[k]), key=lambda k: -rest[k])[:1]
        if not queue:
            return kept
        pivot = queue[0]
        kept.append(pivot)
        waiting = [k for k in waiting if k != pivot]
        direction = left[:, pivot] / rest[pivot]
        left = left - np.outer(direction, direction @ left)
        left[:, kept] = 0.0


def _held(k: int, unknowns: Sequence[Unknown], kept: Sequence[int], share: Array, R: Array) -> Held:
    mine = unknowns[k]
    partners = tuple(
        (unknowns[j].name, float(-c * unknowns[j].scale / mine.scale))
        for j, c in zip(kept, share, strict=True)
        if abs(c) > PARTNER
    )
    if np.linalg.norm(R[:, k]) <= ABSENT * np.linalg.norm(R, axis=0).max() or not partners:
        said = f"{mine.name} has no effect on what is measured in these poses"
        return Held(mine.name, Why.NO_EFFECT, (), said)
    names = [mine.name, *(name for name, _ in partners)]
    return Held(mine.name, Why.TOGETHER, partners, f"{enumerated(names)} move together")


def _weakest(
    R: Array, kept: Sequence[int], unknowns: Sequence[Unknown], noise: float
) -> int | None:
    """The kept parameter of a row that the data know least of, if its bounds know more."""
    inverse = np.linalg.pinv(R[:, list(kept)], rcond=LOST)
    spread = noise * np.linalg.norm(inverse, axis=1)
    ratios = [
        s * np.sqrt(3.0) * unknowns[k].scale / unknowns[k].delta if unknowns[k].cell else 0.0
        for k, s in zip(kept, spread, strict=True)
    ]
    worst = int(np.argmax(ratios)) if ratios else 0
    return kept[worst] if ratios and ratios[worst] > 1.0 else None

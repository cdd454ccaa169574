r"""What a fit can report: sums of parameters that the poses tell, and what each explains.

A column of the Jacobian that is a sum of others, :math:`J_h = \sum_k C_{kh} J_k`, says that the
readings cannot tell a change of :math:`x_h` from changes of its partners. A fit that holds
:math:`x_h` therefore does not estimate :math:`x_k` but

.. math:: z_k = x_k + \sum_h C_{kh}\, x_h,

and whatever values the held ones have, *its* estimate and standard error are the same. Where no
column leans on :math:`x_k` the sum has one term, and the parameter is known by itself. Parameters
that rest on a bound, and those too weak to be free, are held ones too. A lever is a derivative:
what stands behind one is the change of a parameter from the drawing, so that a name with three
digits of it says the number that is reported, however large the angle.

With y the misfits of the nominal links, X the fitted columns, both less what frame and tool make up
for, and :math:`b = (X^T X)^{-1} X^T y`, the mean squared misfit grows by the share

.. math:: s_k = b_k^2 \,/\, \bigl([(X^T X)^{-1}]_{kk}\, |y|^2\bigr)

of what it was if the k-th goes back to the drawing and the others are fitted again (the squared
semipartial correlation: Cohen et al. 2003, Applied Multiple Regression, sec. 3.3). What all explain
beyond the sum of the shares, no single one does: they are confounded.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Self

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.dh_fit.constants import PARTNER, RANK, SLIGHT, WHOLE
from plumbline.optim.dh_fit.statement import FRAME, DHStatement, Pass, Readings, Unknown


@dataclass(frozen=True)
class Misfit:
    """Lengths of misfits [m]."""

    mean: float  # their mean
    max: float  # the largest
    std: float  # their standard deviation
    rms: float  # root of their mean square

    @classmethod
    def of(cls, misfits: Array) -> Self:
        """Of misfits (N, 3) [m]."""
        sizes = np.linalg.norm(misfits, axis=1)
        rms = float(np.sqrt(np.mean(sizes**2)))
        return cls(float(sizes.mean()), float(sizes.max()), float(sizes.std()), rms)

    @property
    def numbers(self) -> dict[str, float]:
        """Mean, largest, standard deviation and RMS by their names [m]."""
        return {key: getattr(self, key) for key in ("mean", "max", "std", "rms")}


class Status(StrEnum):
    """What is known of a parameter."""

    IDENTIFIED = "identified"
    IN_A_SUM = "known in a sum"
    AT_BOUND = "at bound"
    NOT_IDENTIFIABLE = "not identifiable"


@dataclass(frozen=True)
class DHParameter:
    """One parameter of the links, or one coordinate of the tool."""

    name: str  # ``joint 2 a``, ``tip d``, ``tool z``
    unit: str  # ``m`` or ``rad``
    nominal: float  # what the drawing says
    value: float | None  # the estimate; None if it cannot be identified by itself
    std: float | None  # its standard error; None if there is none
    status: Status  # what is known of it
    words: str  # why there is no estimate, or no standard error

    def to_dict(self) -> dict[str, Any]:
        """Its fields, the words by the name of "why"."""
        found = asdict(self)
        return found | {"status": self.status.value, "why": found.pop("words")}


@dataclass(frozen=True)
class Quantity:
    """A sum of parameters that the poses tell."""

    name: str  # ``joint 2 d + joint 3 d``, ``tool x - 0.02 m * change of joint 6 theta``
    # parameters and the coefficients of their changes from the drawing, that it is about first
    parts: tuple[tuple[str, float], ...]
    unit: str  # ``m`` or ``rad``
    nominal: float  # what the drawing says of the sum
    value: float  # the estimate
    std: float  # its standard error
    ci95: tuple[float, float]  # interval that holds the truth in 95 % of all cases

    @property
    def alone(self) -> bool:
        """Whether it is one parameter, known by itself."""
        return len(self.parts) == 1


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums of parameters (K) that the poses tell."""

    unknowns: tuple[Unknown, ...]  # all parameters (P)
    weights: Array  # coefficients (K, P), in the parameters' own units
    leading: tuple[int, ...]  # which parameter each sum is about (K)


def sums(unknowns: Sequence[Unknown], basis: list[int], drawn: Array, fitted: Array) -> Sums:
    """The sums that a fit with some parameters free (``basis``) estimates.

    Who leans on whom is taken from the R (P, P) of the robot as drawn, where axes are parallel,
    with the fitted tool; by how much from the fitted one.
    """
    scale = np.array([u.scale for u in unknowns])
    first, weights = (
        np.linalg.lstsq(R[:, basis], R, rcond=None)[0] * scale[basis, None] / scale[None, :]
        for R in (drawn, fitted)
    )
    weights[np.abs(first) * scale[None, :] <= PARTNER * scale[basis, None]] = 0.0
    weights[:, basis] = np.eye(len(basis))
    links = [i for i, k in enumerate(basis) if unknowns[k].name not in FRAME]
    return Sums(tuple(unknowns), weights[links], tuple(basis[i] for i in links))


def quantities(found: Sums, values: Array, covariance: Array, quantile: float) -> list[Quantity]:
    """Every sum (K) with its estimate, in the chain's order, of values of all parameters (P,)."""
    nominal = np.array([u.nominal for u in found.unknowns])
    spread = np.array([u.delta for u in found.unknowns]) / np.sqrt(3.0)
    reported = []
    for k, row, std in zip(found.leading, found.weights, np.sqrt(np.diag(covariance)), strict=True):
        counts = (np.abs(row) * spread > SLIGHT * std) & (np.abs(row) > 0.0)
        counts[k] = True
        row = np.where(counts, row, 0.0)
        places = [k, *(int(j) for j in np.flatnonzero(counts) if j != k)]
        parts = tuple((found.unknowns[j].name, float(row[j])) for j in places)
        plain = [_plain(u, c, found.unknowns[k]) for u, c in zip(found.unknowns, row, strict=True)]
        at = float(row * plain @ nominal)
        value = at + float(row @ (values - nominal))
        name = " ".join(_term(found.unknowns[j], row[j], found.unknowns[k]) for j in places)
        ends = (value - quantile * float(std), value + quantile * float(std))
        unit = found.unknowns[k].unit
        reported.append(Quantity(name, parts, unit, at, value, float(std), ends))
    return reported


def _plain(part: Unknown, coefficient: float, about: Unknown) -> bool:
    """Whether a parameter counts as it is: behind a lever only its change does."""
    return part.unit == about.unit and abs(abs(coefficient) - 1.0) < WHOLE


def _term(part: Unknown, coefficient: float, about: Unknown) -> str:
    """``joint 2 d``, ``+ joint 3 d``, ``- 0.02 m * change of joint 6 theta``."""
    if part is about:
        return part.name
    sign = "-" if coefficient < 0.0 else "+"
    if _plain(part, coefficient, about):
        return f"{sign} {part.name}"
    unit = "" if part.unit == about.unit else " m" if about.unit == "m" else " rad/m"
    return f"{sign} {abs(coefficient):.3g}{unit} * change of {part.name}"


def shares(
    statement: DHStatement,
    readings: Readings,
    x: Array,
    nominal: Array,
    always: Sequence[int],
    links: Sequence[int],
) -> tuple[Array, float]:
    """Share (L,) of the squared nominal misfits (N, 3) that each of ``links`` explains; of all."""
    if not len(links):
        return np.empty(0), 0.0
    order, R, start = [*always, *links], np.zeros((0, len(always) + len(links) + 1)), 0
    for _, J in Pass(statement, readings).jacobians(x):
        y = nominal[start : start + len(J)].reshape(-1, 1)
        start += len(J)
        block = np.hstack([(J * statement.scale)[:, :, order].reshape(len(y), -1), y])
        R = np.asarray(np.linalg.qr(np.vstack([R, block]), mode="r"))
    inner = R[len(always) :, len(always) :]
    X, y = inner[:, :-1], inner[:, -1]
    total = float(y @ y)
    if not total > 0.0:
        return np.zeros(len(links)), 0.0
    inverse = np.linalg.pinv(X, rcond=RANK)
    b = inverse @ y
    gone = b**2 / np.maximum((inverse**2).sum(axis=1), 1e-300)
    return gone / total, float(1.0 - np.sum((y - X @ b) ** 2) / total)

r"""What a fit can report: sums of parameters that the poses tell, never one that they do not.

A column of the Jacobian that is a sum of others, :math:`J_h = \sum_k C_{kh} J_k`, says that the
readings cannot tell a change of :math:`x_h` from changes of its partners. A fit that holds
:math:`x_h` therefore does not estimate :math:`x_k` but

.. math:: z_k = x_k + \sum_h C_{kh}\, x_h,

and whatever values the held ones have, *its* estimate and standard error are the same. Where no
column leans on :math:`x_k` the sum has one term, and the parameter is known by itself. Parameters
that rest on a bound, and those too weak to be free, are held ones too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.dh_fit.constants import PARTNER, SLIGHT, WHOLE
from plumbline.optim.dh_fit.statement import FRAME, Unknown

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Quantity:
    """A sum of parameters that the poses tell."""

    name: str  # ``joint 2 d + joint 3 d``, ``tool x - 0.02 m * joint 6 theta``
    # parameters and their coefficients, that with coefficient 1 first
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
    """The sums that a fit with some parameters free estimates.

    Who leans on whom is taken from the nominal robot, where axes are parallel as drawn; by how much
    from the fitted one, whose tool may be longer.

    Args:
        unknowns: All parameters (P).
        basis: Those that are free, by place; their columns are independent.
        drawn: R of the Jacobian of all of them (P, P), columns in units of the scales, as drawn.
        fitted: The same as fitted.
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
    """Every sum with its estimate, in the order of the chain.

    Args:
        found: The sums (K).
        values: Fitted or held values of all parameters (P).
        covariance: Of the sums (K, K).
        quantile: How many standard errors an interval of 95 % reaches either way.
    """
    nominal = np.array([u.nominal for u in found.unknowns])
    spread = np.array([u.delta for u in found.unknowns]) / np.sqrt(3.0)
    reported = []
    for k, row, std in zip(found.leading, found.weights, np.sqrt(np.diag(covariance)), strict=True):
        counts = (np.abs(row) * spread > SLIGHT * std) & (np.abs(row) > 0.0)
        counts[k] = True
        row = np.where(counts, row, 0.0)
        places = [k, *(int(j) for j in np.flatnonzero(counts) if j != k)]
        parts = tuple((found.unknowns[j].name, float(row[j])) for j in places)
        value, at = float(row @ values), float(row @ nominal)
        reported.append(
            Quantity(
                " ".join(_term(found.unknowns[j], row[j], found.unknowns[k]) for j in places),
                parts,
                found.unknowns[k].unit,
                at,
                value,
                float(std),
                (value - quantile * float(std), value + quantile * float(std)),
            )
        )
    return reported


def _term(part: Unknown, coefficient: float, about: Unknown) -> str:
    """``joint 2 d``, ``+ joint 3 d``, ``- 0.02 m * joint 6 theta``."""
    if part is about:
        return part.name
    sign, size = "-" if coefficient < 0.0 else "+", abs(coefficient)
    if part.unit == about.unit:
        return (
            f"{sign} {part.name}" if abs(size - 1.0) < WHOLE else f"{sign} {size:.3g} {part.name}"
        )
    unit = "m" if about.unit == "m" else "rad/m"
    return f"{sign} {size:.3g} {unit} * {part.name}"

r"""What a misfit costs: its length, as published, or its square.

With e (3,) the misfit of one reading and :math:`s = \sqrt{|e|^2 + \epsilon^2}`

.. math:: \phi_{norms}(e) = s - \epsilon, \qquad \phi_{squares}(e) = |e|^2 .

The smoothing takes the corner out of the norm at zero. Both are convex in e, so the Hessian of
their mean splits into a positive part, the generalised Gauss-Newton matrix

.. math:: \sum_i J_i^T \nabla^2\phi(e_i) J_i,\qquad
          \nabla^2\phi_{norms} = (I - e e^T / s^2) / s, \quad \nabla^2\phi_{squares} = 2 I,

and a part with the chain's second derivatives, small where the model fits (Messerer, Baumgaertner,
Diehl 2021, ESAIM: Proc. and Surveys 71, eq. 3.6). Least-squares solvers get a residual whose square
*is* the loss, so that they reach the same optimum:

.. math:: |r|^2 = 2\,\phi(e), \qquad r_{norms} = e\,\sqrt{2 / (s + \epsilon)} .
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as cs
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Loss(Protocol):
    """What one misfit e (3,) [m] costs."""

    @property
    def name(self) -> str:
        """What it is called on the command line."""

    @property
    def spread(self) -> float:
        """Variance of its estimates over that of least squares, under Gaussian noise."""

    def values(self, e: Array) -> Array:
        """Cost (N,) of misfits (N, 3)."""

    def slopes(self, e: Array) -> Array:
        """Gradients (N, 3)."""

    def curvatures(self, e: Array) -> tuple[Array, Array]:
        """Factors c (N,) and u (N, 3) of the Hessians ``c (I - u u^T)``."""

    def variance(self, e: Array) -> float:
        """Variance of one axis [m^2] that the typical misfit of (N, 3) stands for."""

    def cost(self, e: cs.SX) -> cs.SX:
        """The cost in symbols."""

    def curvature(self, e: cs.SX) -> cs.SX:
        """The Hessian (3, 3) in symbols."""

    def residual(self, e: cs.SX) -> cs.SX:
        """A residual (3,) of which half the square is the cost."""


@dataclass(frozen=True)
class Norms:
    """The length of the misfit, smoothed.

    Attributes:
        smoothing: epsilon [m]; misfits far below it count as their squares.
    """

    smoothing: float = 1e-6
    name: str = "norms"

    def __post_init__(self) -> None:
        """Refuse a smoothing of zero: the norm has no derivative at zero."""
        if not self.smoothing > 0.0:
            raise ValueError(f"smoothing = {self.smoothing}: must be > 0 m; take 1e-6")

    @property
    def spread(self) -> float:
        """3 pi / 8: what the spatial median loses against the mean in three dimensions."""
        return 3.0 * np.pi / 8.0

    def values(self, e: Array) -> Array:
        """Cost (N,) of misfits (N, 3)."""
        return np.asarray(self._size(e) - self.smoothing)

    def slopes(self, e: Array) -> Array:
        """Gradients (N, 3)."""
        return np.asarray(e / self._size(e)[:, None])

    def curvatures(self, e: Array) -> tuple[Array, Array]:
        """Factors c (N,) and u (N, 3) of the Hessians ``c (I - u u^T)``."""
        size = self._size(e)
        return 1.0 / size, e / size[:, None]

    def variance(self, e: Array) -> float:
        """From the mean length, ``sigma sqrt(8 / pi)`` of Gaussian noise: outliers count less."""
        return float(np.linalg.norm(e, axis=1).mean()) ** 2 * np.pi / 8.0

    def cost(self, e: cs.SX) -> cs.SX:
        """The cost in symbols."""
        return cs.sqrt(cs.sumsqr(e) + self.smoothing**2) - self.smoothing

    def curvature(self, e: cs.SX) -> cs.SX:
        """The Hessian (3, 3) in symbols."""
        size = cs.sqrt(cs.sumsqr(e) + self.smoothing**2)
        return (cs.SX.eye(3) - e @ e.T / size**2) / size

    def residual(self, e: cs.SX) -> cs.SX:
        """A residual (3,) of which half the square is the cost."""
        size = cs.sqrt(cs.sumsqr(e) + self.smoothing**2)
        return e * cs.sqrt(2 / (size + self.smoothing))

    def _size(self, e: Array) -> Array:
        return np.sqrt(np.einsum("nk,nk->n", e, e) + self.smoothing**2)


@dataclass(frozen=True)
class Squares:
    """The square of the misfit."""

    name: str = "squares"
    spread: float = 1.0

    def values(self, e: Array) -> Array:
        """Cost (N,) of misfits (N, 3)."""
        return np.asarray(np.einsum("nk,nk->n", e, e))

    def slopes(self, e: Array) -> Array:
        """Gradients (N, 3)."""
        return 2.0 * e

    def curvatures(self, e: Array) -> tuple[Array, Array]:
        """Factors c (N,) and u (N, 3) of the Hessians ``c (I - u u^T)``."""
        return np.full(len(e), 2.0), np.zeros_like(e)

    def variance(self, e: Array) -> float:
        """The mean square of one axis."""
        return float(np.mean(e**2))

    def cost(self, e: cs.SX) -> cs.SX:
        """The cost in symbols."""
        return cs.sumsqr(e)

    def curvature(self, e: cs.SX) -> cs.SX:
        """The Hessian (3, 3) in symbols."""
        return 2 * cs.SX.eye(3)

    def residual(self, e: cs.SX) -> cs.SX:
        """A residual (3,) of which half the square is the cost."""
        return np.sqrt(2.0) * e

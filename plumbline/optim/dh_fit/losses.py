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

from dataclasses import dataclass
from typing import Protocol

import casadi as cs
import numpy as np

from plumbline.declared import Declared, Positive
from plumbline.optim.core.problem import Array
from plumbline.optim.dh_fit.constants import COUNT_OF_DIRECTIONS, MEDIAN


def _directions(count: int) -> Array:
    """Unit vectors (count, 3) spread evenly (Gonzalez 2010, Math. Geosci. 42(1))."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    wide = np.sqrt(1.0 - height**2)
    return np.column_stack([wide * np.cos(turn), wide * np.sin(turn), height])


DIRECTIONS = _directions(COUNT_OF_DIRECTIONS)
DIRECTIONS.setflags(write=False)


class Loss(Protocol):
    """What one misfit e (3,) [m] costs."""

    @property
    def name(self) -> str:
        """What it is called on the command line."""

    def moments(self, S: Array) -> tuple[Array, Array]:
        """Means (3, 3) of its Hessian and of its gradient's square, for e of covariance S [m^2]."""

    def values(self, e: Array) -> Array:
        """Cost (N,) of misfits (N, 3)."""

    def slopes(self, e: Array) -> Array:
        """Gradients (N, 3)."""

    def curvatures(self, e: Array) -> tuple[Array, Array]:
        """Factors c (N,) and u (N, 3) of the Hessians ``c (I - u u^T)``."""

    def variance(self, e: Array) -> float:
        """Variance of one axis [m^2] that the typical misfit of (N, 3) stands for."""

    def drawn(self, unknowns: int) -> int:
        """How many rows so many unknowns may bring to no misfit at all, whatever their noise."""

    def residual(self, e: cs.SX) -> cs.SX:
        """A residual (3,) of which half the square is the cost."""


@dataclass(frozen=True)
class Norms(Declared):
    """The length of the misfit, smoothed."""

    smoothing: Positive = 1e-6  # epsilon [m]; misfits far below it count as their squares
    name: str = "norms"

    def moments(self, S: Array) -> tuple[Array, Array]:
        """For Gaussian e, whose length and direction are independent once S is a sphere.

        With S such, variances are 3 pi / 8 of those of squares: what the spatial median loses
        against the mean in three dimensions (Brown 1983, J. R. Stat. Soc. B 45(1)).
        """
        values, vectors = np.linalg.eigh(S)
        e = DIRECTIONS * np.sqrt(np.maximum(values, 1e-300)) @ vectors.T
        size = np.linalg.norm(e, axis=1)
        u = e / size[:, None]
        bent = (np.eye(3) - u[:, :, None] * u[:, None, :]) / size[:, None, None]
        return np.sqrt(2.0 / np.pi) * bent.mean(axis=0), u.T @ u / len(u)

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
        """From the median length, 1.54 sigma of Gaussian noise: outliers hardly count."""
        return float(np.median(np.einsum("nk,nk->n", e, e)) / MEDIAN)

    def drawn(self, unknowns: int) -> int:
        """A row for every three of them."""
        return unknowns // 3

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

    def moments(self, S: Array) -> tuple[Array, Array]:
        """Means (3, 3) of its Hessian and of its gradient's square, for e of covariance S [m^2]."""
        return 2.0 * np.eye(3), 4.0 * S

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

    def drawn(self, unknowns: int) -> int:
        """None: a square has no corner at zero."""
        return 0

    def residual(self, e: cs.SX) -> cs.SX:
        """A residual (3,) of which half the square is the cost."""
        return np.sqrt(2.0) * e

r"""How well the unknowns are known, whatever the shape of the noise.

An estimate that makes :math:`\sum_i \phi(e_i)` least has, for noise of any covariance S of the
three axes, the covariance (Huber 1967, Proc. 5th Berkeley Symp., theorem 3)

.. math:: C = M_A^{-1} M_B M_A^{-1}, \qquad M_A = \sum_i J_i^T A J_i,\quad
          M_B = \sum_i J_i^T B J_i,\qquad A = E\,\nabla^2\phi(e),\quad
          B = E\,\nabla\phi(e)\,\nabla\phi(e)^T .

S is one for all rows, so that few are enough to know it, and A and B follow from S: a fit of norms
draws some misfits to zero, where a mean of its own Hessian would take them for little noise. For
noise of one size it is :math:`c\,\sigma^2 (J^T J)^{-1}`, c = 1 for squares and
:math:`3\pi/8` for norms. Readings count; registration points' own noise comes on top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.dh_fit.identify import triangle
from plumbline.optim.dh_fit.statement import Readings, Statement

Array = NDArray[np.float64]


def factor(
    statement: Statement, readings: Readings, x: Array, free: NDArray[np.intp], S: Array
) -> Array:
    """F (free, P) with ``F F^T`` the covariance of the free unknowns, in units of the scales.

    Args:
        statement: The problem.
        readings: Readings (N).
        x: Its solution (P,).
        free: Which unknowns are free, by place; the others count as known.
        S: Covariance (3, 3) of a reading's noise, robot's frame [m^2].
    """
    A, B = statement.loss.moments(S)
    inverse = np.linalg.pinv(triangle(statement, readings, x, root(A))[:, free], rcond=1e-12)
    lower = triangle(statement, readings, x, root(B))[:, free]
    return np.asarray(inverse @ inverse.T @ lower.T)


def root(B: Array) -> Array:
    """W (3, 3), symmetric, with ``W W = B``."""
    values, vectors = np.linalg.eigh(B)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)

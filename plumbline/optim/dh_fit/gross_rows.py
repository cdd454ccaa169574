r"""How well the unknowns are known whatever the noise's shape, and rows that no links can mean.

An estimate that makes :math:`\sum_i \phi(e_i)` least has, for noise of any covariance S of the
three axes, the covariance (Huber 1967, Proc. 5th Berkeley Symp., theorem 3)

.. math:: C = M_A^{-1} M_B M_A^{-1}, \qquad M_A = \sum_i J_i^T A J_i,\quad
          M_B = \sum_i J_i^T B J_i,\qquad A = E\,\nabla^2\phi(e),\quad
          B = E\,\nabla\phi(e)\,\nabla\phi(e)^T .

S is one for all rows, so that few are enough to know it, and A and B follow from S: a fit of norms
draws some misfits to zero, where a mean of its own Hessian would take them for little noise. For
noise of one size it is :math:`c\,\sigma^2 (J^T J)^{-1}`, c = 1 for squares and :math:`3\pi/8` for
norms. Readings count; registration points' own noise comes on top. With H that of least squares,

.. math:: D_i = e_i^T C_i^{-1} e_i / 3, \qquad C_i = \bigl[(I - H)\, V\, (I - H)\bigr]_{ii},
          \qquad H = J (J^T J)^{-1} J^T

is the misfit of a row over what the fit leaves of noise of covariance V (Belsley, Kuh, Welsch 1980,
sec. 2.1, for noise of any shape). Over its scale it is distributed as F with 3 degrees of freedom
and those of the noise. No gross row sets a standard: the scale comes from the median of D, of a fit
of norms without as many of the least as it may draw to zero (Street, Carroll, Ruppert 1988, Am.
Stat. 42(2)), and the shape V from the directions of the misfits alone (Tyler 1987, Ann. Stat.
15(1)),

.. math:: V \leftarrow \frac3n \sum_i e_i e_i^T / (e_i^T V^{-1} e_i) .
"""

import numpy as np
from scipy.special import fdtri

from plumbline.optim.core.judged import root_of
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.dh_fit import constants
from plumbline.optim.dh_fit.identify import triangle
from plumbline.optim.dh_fit.statement import DHStatement, Pass, Readings


def factor(statement: DHStatement, readings: Readings, x: Array, free: Indices, S: Array) -> Array:
    """F (free, P) with ``F F^T`` the covariance of the free unknowns, in units of the scales.

    S (3, 3) is that of a reading's noise, robot's frame [m^2]; all others count as known.
    """
    A, B = statement.loss.moments(S)
    inverse = np.linalg.pinv(
        triangle(statement, readings, x, root_of(A))[:, free], rcond=constants.RANK
    )
    lower = triangle(statement, readings, x, root_of(B))[:, free]
    return np.asarray(inverse @ inverse.T @ lower.T)


def gross_rows(statement: DHStatement, readings: Readings, x: Array, free: Indices) -> Flags:
    """Which rows (N,) are grossly wrong; none where too many are, or too few tell."""
    none = np.zeros(len(readings), dtype=bool)
    freedom = 3 * len(readings) - len(free)
    if freedom < constants.FEWEST_FREEDOM:
        return none
    statistic = _deletion(statement, readings, x, free) / 3.0
    # Half of the rows stand for the noise: a median knows it less well than a sum of squares.
    tail = (3.0, freedom / 2.0)
    told = np.sort(statistic)[statement.loss.drawn(len(free)) :]
    scale = float(np.median(told)) / float(fdtri(*tail, 0.5))
    limit = constants.SLACK * float(fdtri(*tail, 1.0 - constants.FALSE_ALARM / len(readings)))
    found = statistic > limit * max(scale, 1e-300)
    return found if found.sum() <= constants.MOST_SHARE * len(readings) else none


def shape(e: Array) -> Array:
    """V (3, 3) of misfits (N, 3), of trace 3; rows without any misfit have no direction."""
    e = e[np.linalg.norm(e, axis=1) > 0.0]
    V = np.eye(3)
    for _ in range(constants.SHAPE_ROUNDS if len(e) >= constants.FEWEST_ROWS else 0):
        sizes = np.einsum("nk,kl,nl->n", e, np.linalg.inv(V), e)
        V = (e / sizes[:, None]).T @ e + constants.LEAST_SHAPE * len(e) * np.eye(3)
        V *= 3.0 / np.trace(V)
    return np.asarray(V)


def _deletion(statement: DHStatement, readings: Readings, x: Array, free: Indices) -> Array:
    rows = Pass(statement, readings)
    V = shape(rows.misfits(x))
    W = root_of(V)
    narrow = np.linalg.inv(W)
    inverse = np.linalg.pinv(triangle(statement, readings, x)[:, free], rcond=constants.RANK)
    moved = inverse.T @ triangle(statement, readings, x, W)[:, free].T
    found = []
    for e, J in rows.jacobians(x):
        lever = (J * statement.scale)[:, :, free] @ inverse
        H, spread = lever @ lever.transpose(0, 2, 1), lever @ moved
        C = V - H @ V - V @ H + spread @ spread.transpose(0, 2, 1)
        values, vectors = np.linalg.eigh(narrow @ C @ narrow)
        along = np.einsum("nkl,nk->nl", vectors, e @ narrow)
        found.append((along**2 / np.maximum(values, constants.LEAST_LEFT)).sum(axis=1))
    return np.concatenate(found)

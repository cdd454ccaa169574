r"""What the rows say of the beam once every plane and bow is eliminated.

With A the Jacobian times the root of the weights, its columns scaled by the unknowns' sizes S, and
Q an orthonormal basis of the nuisances' columns,

.. math:: A_b' = (I - Q Q^T) A_b = U\, \mathrm{diag}(s)\, V^T, \qquad
          \Sigma_b = S V\, \mathrm{diag}(s^{-2})\, V^T S

the marginal covariance (Schur's complement). A direction without rows behind it has s = 0 and an
infinite variance; it must never be dropped, which would give it none.
"""

from __future__ import annotations

import numpy as np

from plumbline.optim.core.problem import Problem
from plumbline.optim.hand_eye.beam import Array

BEAM = 5  # first unknowns of the statement: r and the slope of v
NUISANCE_RANK = 1e-10  # of the largest singular value: nuisances that no row shows
NOTHING = 1e-12  # singular value [scaled] below which nothing is known: an error of 10^10 m


def marginal_covariance(problem: Problem, J: Array, weights: Array) -> Array:
    """Covariance (5, 5) of the beam's unknowns; astronomic, not zero, where rows say nothing.

    Args:
        problem: The statement, whose scale is used.
        J: Jacobian of all rows (N, P).
        weights: Weights of all rows (N,) [1/m^2].
    """
    A = J * np.sqrt(weights)[:, None] * problem.scale
    U, sizes, _ = np.linalg.svd(A[:, BEAM:], full_matrices=False)
    Q = U[:, sizes > NUISANCE_RANK * sizes[0]]
    free = A[:, :BEAM] - Q @ (Q.T @ A[:, :BEAM])
    _, s, Vt = np.linalg.svd(free, full_matrices=False)
    root = problem.scale[:BEAM, None] * Vt.T / np.maximum(s, NOTHING)
    return np.asarray(root @ root.T)

r"""Whether the finder's scale is off: one more column beside the fit, which has none.

A range that is read as :math:`d (1 + s)` puts its point :math:`s\, d \cos\theta` off the board.
With A the weighted Jacobian of all rows, Q an orthonormal basis of its columns and a the weighted
column of that, what the fit leaves of it tells s (Frisch and Waugh 1933, Econometrica 1(4)):

.. math:: \tilde a = (I - Q Q^T)\, a, \qquad
          \hat s = \frac{\tilde a^T e}{\tilde a^T \tilde a}, \qquad
          \sigma_s = \frac{1}{|\tilde a|}

The boards' and the arm's smooth shapes are among the columns: what they may be, s is not.
"""

import numpy as np

from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye import constants
from plumbline.optim.hand_eye.reweighting import LikelyFit, rows_at


def scale_told(
    solution: Solution, fit: LikelyFit, distance: Array, incidence: Array
) -> tuple[float, float]:
    """The scale's deviation and its standard error, by readings (N,) [m] at angles (N,) [rad]."""
    e, J = rows_at(solution.mapped, solution.x)
    root = np.sqrt(fit.relative * np.mean(1.0 / fit.variance.at(incidence)))
    U, sizes, _ = np.linalg.svd(J * root[:, None] * solution.problem.scale, full_matrices=False)
    Q = U[:, sizes > constants.NUISANCE_RANK * sizes[0]]
    a = np.zeros(len(e))
    a[: len(distance)] = distance * np.cos(incidence)
    a *= root
    left = a - Q @ (Q.T @ a)
    size = max(float(np.linalg.norm(left)), constants.NOTHING)
    return float(left @ (root * e)) / size**2, 1.0 / size

r"""How much of the misfit each thing that was fitted explains.

With y the misfits of the nominal links, X the fitted columns, both less what frame and tool make up
for, and :math:`b = (X^T X)^{-1} X^T y`, the mean squared misfit grows by the share

.. math:: s_k = b_k^2 \,/\, \bigl([(X^T X)^{-1}]_{kk}\, |y|^2\bigr)

of what it was if the k-th goes back to the drawing and the others are fitted again (the squared
semipartial correlation: Cohen et al. 2003, Applied Multiple Regression, sec. 3.3). What all explain
beyond the sum of the shares, no single one does: they stand in for each other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.dh_fit.statement import Readings, Statement
from plumbline.optim.dh_fit.sums import Pass

Array = NDArray[np.float64]


def shares(
    statement: Statement,
    readings: Readings,
    x: Array,
    nominal: Array,
    always: Sequence[int],
    links: Sequence[int],
) -> tuple[Array, float]:
    """Share (L,) of the nominal links' mean squared misfit that each column explains; all together.

    Args:
        statement: The problem.
        readings: Readings (N).
        x: Its solution (P,).
        nominal: Misfits (N, 3) of the nominal links, frame and tool fitted [m].
        always: Places of frame and tool among the unknowns.
        links: Places of the columns to share (L).
    """
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
    inverse = np.linalg.pinv(X, rcond=1e-12)
    b = inverse @ y
    gone = b**2 / np.maximum((inverse**2).sum(axis=1), 1e-300)
    return gone / total, float(1.0 - np.sum((y - X @ b) ** 2) / total)

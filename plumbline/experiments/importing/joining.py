r"""Tables of several files or topics meet at the nearest moment.

Row i of the measured table at :math:`t_i` takes from another table the row at

.. math:: j(i) = \arg\min_j |t_i - (s_j + c)|, \qquad |t_i - (s_{j(i)} + c)| \le \text{gap},

with a stated shift c of its clock; a row without such a partner is left out. Nothing is
interpolated: what is written was read.
"""

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.importing.tables import Array

NOBODY = -1  # the partner of a row that has none
ROUNDING = 1e-9  # [s] by which a difference may pass the gap: clocks in decimals


def partners(moments: Array, others: Array, gap: float) -> NDArray[np.int64]:
    """The nearest row of another table to each row (N,), :data:`NOBODY` where none is near.

    Clocks (N,) and (M,) [s] in any order, nan for none; two readings may be ``gap`` [s] apart.
    """
    order = np.argsort(others, kind="stable")
    order = order[: int(np.isfinite(others).sum())]  # nan is sorted last
    if not len(order):
        return np.full(len(moments), NOBODY)
    clock = others[order]
    after = np.clip(np.searchsorted(clock, moments), 0, len(clock) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.abs(moments - clock[before]) <= np.abs(clock[after] - moments)
    best = np.where(nearer, before, after)
    near = np.abs(moments - clock[best]) <= gap + ROUNDING
    return np.where(near, order[best], NOBODY).astype(np.int64)

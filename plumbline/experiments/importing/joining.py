r"""Tables of several files or topics meet at the nearest moment.

Row i of the measured table at :math:`t_i` takes from another table the row at

.. math:: j(i) = \arg\min_j |t_i - (s_j + c)|, \qquad |t_i - (s_{j(i)} + c)| \le \text{gap},

with a stated shift c of its clock; a row without such a partner is left out. Nothing is
interpolated: what is written was read.

Along its clock the path itself tells velocities, and the side from which a joint came. Velocity is
the derivative of the parabola through three neighbours (Fornberg 1988, Mathematics of Computation
51), which is exact to second order where steps are unequal. The side is that of a play of
half-width w that the joint drags along: it turns only once the joint has moved back by more than
:math:`2w`, so that noise smaller than that is no motion (Visintin 1994, Differential Models of
Hysteresis, sec. III.1).
"""

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.importing.tables import Array

NOBODY = -1  # the partner of a row that has none
ROUNDING = 1e-9  # [s] by which a difference may pass the gap: clocks in decimals
STILL = 1e-3  # [rad] or [m]: a controller's own wander about its target stays below it


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


def velocities(q: Array, time: Array, group: NDArray[np.int64]) -> Array:
    """Velocities (N, n) [rad/s or m/s] of joints (N, n) along each group's (N,) own path.

    The clock (N,) [s] is refused if it stands still between two rows.
    """
    found = np.zeros_like(q)
    for one in np.unique(group):
        rows = np.flatnonzero(group == one)
        steps = np.diff(time[rows])
        if len(rows) > 1 and not (steps > 0.0).all():
            row = int(rows[np.argmin(steps) + 1]) + 1
            raise PlumblineError(
                f"--derive velocity: time {time[row - 1]:.9g} s in row {row} is not after the row "
                "before, expected a clock that runs; leave doubled rows out, or map a finer clock"
            )
        if len(rows) > 1:
            path, clock = q[rows], time[rows]
            made = [
                np.gradient(path[:, j], clock, edge_order=2 if len(rows) > 2 else 1)
                for j in range(q.shape[1])
            ]
            found[rows] = np.column_stack(made)
    return found


def directions(q: Array, group: NDArray[np.int64], still: float = STILL) -> NDArray[np.int64]:
    """Side (N, n) from which each joint came: -1, 1, or 0 before its first motion.

    Joints (N, n) [rad or m] in the order of time, by groups (N,) of rows that follow each other.
    Motion back by ``still`` [rad or m] counts as none; half of it before the first motion.
    """
    found = np.zeros(q.shape, dtype=np.int64)
    dragged = q[0] if len(q) else q
    for row in range(1, len(q)):
        if group[row] != group[row - 1]:
            dragged = q[row]
            continue
        moved = np.clip(dragged, q[row] - still / 2.0, q[row] + still / 2.0)
        found[row] = np.where(moved == dragged, found[row - 1], np.sign(moved - dragged))
        dragged = moved
    return found

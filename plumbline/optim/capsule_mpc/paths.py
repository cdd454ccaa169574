r"""The rates of a path that is to be followed: what a smooth command is compared with.

Of points r_1 .. r_p the steps and their changes are

.. math:: s_k = r_k - r_{k-1}, \qquad t_k = s_k - s_{k-1}

with the points before the first on the parabola of the first three. A path that leaps asks for no
more than a tip can do: steps are shortened to the largest.
"""

from functools import lru_cache

import casadi as cs

from plumbline.optim.capsule_mpc.constants import TOUCHING
from plumbline.optim.capsule_mpc.statement import Statement, StatementShape


@lru_cache(maxsize=32)
def path_function(shape: StatementShape) -> cs.Function:
    """``points (n, p) -> steps (n, p), changes (n, p)``; zeros where goals are no states."""
    own = shape.statement
    p, points = own.settings.p, cs.SX.sym("r", own.goals, own.settings.p)
    steps = changes = cs.SX.zeros(own.n, p)
    if own.by_states and p > 2:
        later = _shortened(own, points[:, 1:] - points[:, :-1])
        steps = cs.horzcat(2 * later[:, 0] - later[:, 1], later)
        after = steps[:, 1:] - steps[:, :-1]
        changes = cs.horzcat(after[:, 0], after)
    return cs.Function("path", [points], [steps, changes])


def _shortened(own: Statement, steps: cs.SX) -> cs.SX:
    most, rows = own.step[0], []
    for part in own.blocks:
        size = cs.sqrt(cs.sum1(steps[part, :] ** 2))
        share = cs.fmin(1.0, most[part.start] / cs.fmax(size, TOUCHING))
        rows.append(steps[part, :] * cs.repmat(share, part.stop - part.start, 1))
    return cs.vertcat(*rows)

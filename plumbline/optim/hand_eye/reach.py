r"""Whether an arm reaches a pose from a posture near by: damped Newton steps on the pose's error.

.. math:: q \leftarrow q + J^T (J J^T + \mu I)^{-1} \begin{bmatrix} t^* - t \\ \tfrac12 \sum_i
          R_{:i} \times R^*_{:i} \end{bmatrix}

(Nakamura and Hanafusa 1986), for all poses at once.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.evaluate import over_rows
from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.constants import ARRIVED, LONGEST_STEP, REACH_STEPS

DAMPING = 1e-6


@lru_cache(maxsize=4)
def _error(chain: Chain) -> cs.Function:
    """(q, R*, t*) -> the pose's error (6,) and its Jacobian by q, negative."""
    q, goal = cs.SX.sym("q", chain.n), cs.SX.sym("goal", 12)
    T = chain.forward(q)
    R_goal, t_goal = cs.reshape(goal[:9], 3, 3), goal[9:]
    turn = sum((cs.cross(T.R[:, i], R_goal[:, i]) for i in range(3)), cs.SX(3, 1)) / 2
    error = cs.vertcat(t_goal - T.t, turn)
    row = cs.vertcat(q, goal)
    return cs.Function("error", [row], [cs.densify(error), cs.densify(-cs.jacobian(error, q).T)])


def reach(chain: Chain, near: Array, T: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Postures that bring the tip to poses.

    Args:
        chain: The arm.
        near: Postures to start from (N, n) [rad or m].
        T: Poses of the tip in the base frame (N, 4, 4) [m].

    Returns:
        Postures (N, n), and which of them arrive within the joint limits (N,).
    """
    q = np.array(near)
    goals = np.hstack([np.swapaxes(T[:, :3, :3], 1, 2).reshape(-1, 9), T[:, :3, 3]])
    for _ in range(REACH_STEPS):
        error, J = over_rows(_error(chain), np.hstack([q, goals]))
        e, J = error[:, 0], J.transpose(0, 1, 2)
        gram = J @ np.swapaxes(J, 1, 2) + DAMPING * np.eye(6)
        step = np.einsum("nij,ni->nj", J, np.linalg.solve(gram, e[..., None])[..., 0])
        size = np.linalg.norm(step, axis=1, keepdims=True)
        q = q + step * np.minimum(1.0, LONGEST_STEP / np.maximum(size, 1e-12))
    error, _ = over_rows(_error(chain), np.hstack([q, goals]))
    arrived = np.abs(error[:, 0]).max(axis=1) < ARRIVED
    return q, arrived & np.all((q >= chain.lower) & (q <= chain.upper), axis=1)

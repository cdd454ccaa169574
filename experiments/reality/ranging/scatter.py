r"""How much the joints must scatter for the flange to scatter as the maker says.

.. math:: \sigma_q = \sqrt 3\, \sigma_{axis} / \sqrt{\textstyle\sum_i |z_i \times (p - o_i)|^2}

for revolute joints about z_i through o_i and a flange at p.
"""

from __future__ import annotations

import numpy as np

from experiments.reality.arm import Array


def joint_scatter(frames: Array, per_axis: float) -> Array:
    """Scatter of each joint (N,) [rad] that moves the flange by `per_axis` [m] along each axis.

    Args:
        frames: (N, n + 1, 4, 4) frames of the links in the base frame.
        per_axis: Scatter of the flange per axis, 1 sigma [m].
    """
    axes, origins = frames[:, :-1, :3, 2], frames[:, :-1, :3, 3]
    levers = np.linalg.norm(np.cross(axes, frames[:, -1:, :3, 3] - origins), axis=2)
    return np.asarray(np.sqrt(3.0) * per_axis / np.linalg.norm(levers, axis=1))

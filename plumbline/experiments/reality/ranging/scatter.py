r"""How much the joints must scatter for the flange to scatter as the maker says.

.. math:: \sigma_q = \sqrt 3\, \sigma_{axis} / \sqrt{\textstyle\sum_i |z_i \times (p - o_i)|^2}

for revolute joints about z_i through o_i and a flange at p.

A built arm besides differs from its drawing: every link and joint zero is a little off, all by so
much that the flange errs by a given root mean square over the workspace.
"""

from dataclasses import replace

import numpy as np

from plumbline.experiments.reality.arm import Arm, Array, forward

LENGTHS, ANGLES = 0.3e-3, 1e-3  # m, rad: how lengths and angles share an arm's error
POSTURES = 200


def joint_scatter(frames: Array, per_axis: float) -> Array:
    """Scatter of each joint (N,) [rad] that moves the flange by `per_axis` [m] along each axis.

    By the frames (N, n + 1, 4, 4) of the links in the base frame; both are of 1 sigma.
    """
    axes, origins = frames[:, :-1, :3, 2], frames[:, :-1, :3, 3]
    levers = np.linalg.norm(np.cross(axes, frames[:, -1:, :3, 3] - origins), axis=2)
    return np.asarray(np.sqrt(3.0) * per_axis / np.linalg.norm(levers, axis=1))


def as_built(arm: Arm, error: float, rng: np.random.Generator) -> Arm:
    """An arm whose flange lies `error` [m], root mean square, from where the drawing has it."""
    n = arm.joints
    steps = {
        "d": rng.normal(0.0, LENGTHS, n), "a": rng.normal(0.0, LENGTHS, n),
        "alpha": rng.normal(0.0, ANGLES, n), "theta": rng.normal(0.0, ANGLES, n),
    }  # fmt: skip
    q = rng.uniform(0.5 * arm.lower, 0.5 * arm.upper, (POSTURES, n))

    def off(share: float) -> Arm:
        return replace(arm, **{name: getattr(arm, name) + share * s for name, s in steps.items()})

    gaps = (forward(off(1.0), q) - forward(arm, q))[:, -1, :3, 3]
    return off(error / float(np.sqrt(np.mean(np.sum(gaps**2, axis=1)))))

r"""A camera in the range finder's place, on the same motions: what its hand-eye problem would be.

It sits at r and looks along v; a target stands in the middle of a board, and the camera measures
its pose with noise:

.. math:: T_{ct} = T_{fc}^{-1}\, T_{bf}^{-1}\, T_{bt}\, \delta

with b the base, f the flange, c the camera, t the target, and delta a small random motion.
"""

import numpy as np

from plumbline.experiments.reality.arm import Array, forward, rotations
from plumbline.experiments.reality.ranging.aim import taking
from plumbline.experiments.reality.ranging.scene import Scene, true_flange

SHIFT, TURN = 0.1e-3, 0.5e-3  # m, rad: noise of a target's pose per axis, 1 sigma


def camera_place(scene: Scene) -> Array:
    """``T_flange_camera`` (4, 4) [m]: at r, its z along v."""
    T = np.eye(4)
    T[:3, :3] = taking(np.array([[0.0, 0.0, 1.0]]), scene.finder.v[None])[0]
    T[:3, 3] = scene.finder.r
    return T


def target_poses(
    scene: Scene, q: Array, board: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """What the encoders and the camera say.

    Args:
        scene: The scene.
        q: Postures (N, n) [rad].
        board: The board that carries the target, from 1.
        rng: Source of chance.

    Returns:
        ``T_base_flange`` (N, 4, 4) by the encoders, ``T_camera_target`` (N, 4, 4) as measured.
    """
    face = scene.boards[board - 1]
    target = np.eye(4)
    target[:3, :3], target[:3, 3] = face.axes, face.centre
    seen = np.linalg.inv(true_flange(scene, q, rng) @ camera_place(scene)) @ target
    noise = np.tile(np.eye(4), (len(q), 1, 1))
    noise[:, :3, :3] = rotations(rng.normal(0.0, TURN, (len(q), 3)))
    noise[:, :3, 3] = rng.normal(0.0, SHIFT, (len(q), 3))
    return forward(scene.arm, q)[:, -1], seen @ noise

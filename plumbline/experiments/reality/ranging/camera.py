r"""A camera in the range finder's place, on the same motions: what its hand-eye problem would be.

It sits at r and looks along v; a target stands in the middle of a board, and the camera measures
its pose with noise:

.. math:: T_{ct} = T_{fc}^{-1}\, T_{bf}^{-1}\, T_{bt}\, \delta

with b the base, f the flange, c the camera, t the target, and delta a small random motion.
"""

import numpy as np

from plumbline.experiments.reality.arm import Array, forward, placed, rotations
from plumbline.experiments.reality.ranging.aim import taking
from plumbline.experiments.reality.ranging.scene import Scene, true_flange

SHIFT, TURN = 0.1e-3, 0.5e-3  # m, rad: noise of a target's pose per axis, 1 sigma


def camera_place(scene: Scene) -> Array:
    """``T_flange_camera`` (4, 4) [m]: at r, its z along v."""
    return placed(taking(np.array([[0.0, 0.0, 1.0]]), scene.finder.v[None])[0], scene.finder.r)


def target_poses(
    scene: Scene, q: Array, board: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """What encoders and camera say at postures (N, n) [rad] of a target on a board, from 1.

    ``T_base_flange`` (N, 4, 4) by the encoders, ``T_camera_target`` (N, 4, 4) as measured [m].
    """
    face = scene.boards[board - 1]
    camera = true_flange(scene, q, rng) @ camera_place(scene)
    turn, shift = (rng.normal(0.0, size, (len(q), 3)) for size in (TURN, SHIFT))
    seen = np.linalg.inv(camera) @ placed(face.axes, face.centre) @ placed(rotations(turn), shift)
    return forward(scene.arm, q)[:, -1], seen

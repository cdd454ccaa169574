r"""The floor gives where the arm leans, and less elsewhere.

.. math:: \Delta p = \text{size} \exp(-|x - x_0|^2 / 2 w^2)\, g / |g|

with x the foot of the arm's centre of gravity: the middle of a plate between joists sinks, its edge
does not (Timoshenko and Woinowsky-Krieger 1959, Theory of Plates and Shells: the influence
surface of a supported plate, here a bell).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.scene import Mechanism, Scene


@dataclass(frozen=True)
class FloorSag(Mechanism):
    """A sink of `size` m with the weight above the middle; places and width [m] on the floor."""

    middle: tuple[float, ...] = (0.0, 0.0)
    width: float = 0.1
    effect, limit, named, stage = "floor_sag", 0.02, ("sink", "middle", "width"), "base"
    depends_on = ("posture",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> FloorSag:
        """A middle that the weight comes to, and a bell narrower than its way."""
        feet = weight_above(scene)
        spread = float(np.sqrt(np.mean(np.sum((feet - feet.mean(axis=0)) ** 2, axis=1))))
        middle = feet[int(rng.integers(len(feet)))]
        width = spread * float(rng.uniform(0.5, 0.9))
        return cls(0.0, tuple(float(v) for v in middle), width)

    def _body(self, scene: Scene) -> Scene:
        away = np.sum((weight_above(scene) - np.array(self.middle)) ** 2, axis=1)
        down = scene.arm.gravity / np.linalg.norm(scene.arm.gravity)
        base = scene.base.copy()
        base[:, :3] += self.size * np.exp(-0.5 * away / self.width**2)[:, None] * down
        return replace(scene, base=base)


def weight_above(scene: Scene) -> Array:
    """Where on the floor the arm's centre of gravity stands (N, 2) [m]."""
    frames = scene.frames()[:, 1:]
    centres = frames[..., :3, 3] + np.einsum("nijk,ik->nij", frames[..., :3, :3], scene.arm.com)
    share = scene.arm.mass / scene.arm.mass.sum()
    return np.asarray(np.einsum("i,nik->nk", share, centres)[:, :2])

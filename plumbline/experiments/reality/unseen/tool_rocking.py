r"""A tool on a worn seat rocks from one face to the other as gravity turns over.

.. math:: \Delta p_{tool} = \text{size}\, \tanh((g \cdot u - b) / s)\, v

with g the direction of gravity in the flange. A seat constrained twice has two stable places and
little between them (Slocum 1992, Precision Machine Design, ch. 7).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen.chances import unit


@dataclass(frozen=True)
class ToolRocking(Mechanism):
    """A step of twice `size` m along `way` where gravity along `face` passes `bias`."""

    face: tuple[float, ...] = (1.0, 0.0, 0.0)
    way: tuple[float, ...] = (1.0, 0.0, 0.0)
    bias: float = 0.0
    softness: float = 0.1
    effect, limit, named, stage = "tool_rocking", 0.02, ("half_step", "bias"), "tool"
    depends_on = ("posture",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> ToolRocking:
        """Any face, any way."""
        bias, softness = rng.uniform(-0.3, 0.3), rng.uniform(0.03, 0.15)
        return cls(0.0, unit(rng), unit(rng), float(bias), float(softness))

    def _body(self, scene: Scene) -> Scene:
        down = scene.arm.gravity / np.linalg.norm(scene.arm.gravity)
        along = down @ (scene.frames()[:, -1, :3, :3] @ np.array(self.face)).T
        rocked = np.tanh((along - self.bias) / self.softness)
        return replace(scene, tool=scene.tool + self.size * rocked[:, None] * np.array(self.way))

r"""A hose to the tool is slack near its anchor and pulls the tip back beyond its length.

.. math:: \Delta p = \text{size} \max(0, (|p - a| - L) / L)\, (a - p) / |a - p|

Irvine (1981), Cable Structures: a cable bears nothing until its sag is used up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen.chances import unit


@dataclass(frozen=True)
class HoseDrag(Mechanism):
    """A pull of `size` m at twice the hose's length [m]; the anchor [m] in the base frame."""

    anchor: tuple[float, ...] = (0.0, 0.0, 1.0)
    length: float = 0.5
    effect, limit, named, stage = "hose_drag", 0.1, ("pull", "anchor", "length"), "tool"
    depends_on = ("position",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> HoseDrag:
        """Hung beside the cloud of tips, taut in a third to a half of the rows."""
        _, tips = scene.tip()
        spread = float(np.sqrt(np.mean(np.sum((tips - tips.mean(axis=0)) ** 2, axis=1))))
        anchor = tips.mean(axis=0) + spread * np.array(unit(rng))
        away = np.linalg.norm(tips - anchor, axis=1)
        length = float(np.quantile(away, rng.uniform(0.5, 0.67)))
        return cls(0.0, tuple(float(v) for v in anchor), length)

    def _body(self, scene: Scene) -> Scene:
        _, tips = scene.tip()
        back = np.array(self.anchor) - tips
        away = np.linalg.norm(back, axis=1, keepdims=True)
        pull = np.maximum(away - self.length, 0.0) / self.length
        return replace(scene, sag=scene.sag + self.size * pull * back / away)

r"""A measuring volume stitched from two stations: beyond the seam everything is shifted.

.. math:: \Delta p = \text{size}\; u\, [(p - c) \cdot n > 0]

Predmore (2010), Precision Engineering 34(1), on bundling several stations of a tracker: what their
common points leave over is a step between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.scene import Mechanism, Scene, Session
from plumbline.experiments.reality.unseen.chances import unit


@dataclass(frozen=True)
class StitchedVolume(Mechanism):
    """A step of `size` m along `way` behind a seam, all in the device's axes [m]."""

    seam: tuple[float, ...] = (0.0, 0.0, 2.0)
    normal: tuple[float, ...] = (1.0, 0.0, 0.0)
    way: tuple[float, ...] = (0.0, 0.0, 1.0)
    effect, limit, named, stage = "stitched_volume", 0.02, ("step", "seam", "normal"), "sensor"
    depends_on = ("position",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> StitchedVolume:
        """A seam through the cloud of tips."""
        points, _ = scene.pose_in_device()
        seam = points.mean(axis=0) + 0.3 * points.std(axis=0) * rng.normal(size=3)
        return cls(0.0, tuple(float(v) for v in seam), unit(rng), unit(rng))

    def _sense(self, points: Array, session: Session) -> Array:
        behind = (points - np.array(self.seam)) @ np.array(self.normal) > 0.0
        return np.asarray(points + self.size * behind[:, None] * np.array(self.way))

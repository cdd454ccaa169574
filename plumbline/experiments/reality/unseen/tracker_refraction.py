r"""Warm air over the floor bends the tracker's line of sight, the more the lower and farther.

.. math:: \Delta p = \text{size}\, (z / z_0)^2 \exp(-h / h_0)\, d, \qquad h = (p - c) \cdot d

A gradient of the refractive index curves a ray, whose end is missed by half the curvature times the
square of the way (Estler, Edmundson, Peggs and Parker 2002, CIRP Annals 51(2)); the gradient
fades with height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.scene import Mechanism, Scene, Session
from plumbline.experiments.reality.unseen.chances import TURN


@dataclass(frozen=True)
class TrackerRefraction(Mechanism):
    """A miss of `size` m at the mean depth [m] and height; `turn` [rad] says where up is."""

    depth: float = 2.0
    height: float = 0.5
    centre: tuple[float, ...] = (0.0, 0.0, 2.0)
    turn: float = 0.0
    effect, limit, stage = "tracker_refraction", 0.02, "sensor"
    named = ("miss", "depth", "height")
    depends_on = ("position",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> TrackerRefraction:
        """A layer about as high as the cloud of tips."""
        points, _ = scene.pose_in_device()
        middle = points.mean(axis=0)
        spread = float(np.sqrt(np.mean((points - middle) ** 2)))
        return cls(
            0.0,
            float(middle[2]),
            spread * float(rng.uniform(0.7, 1.5)),
            tuple(float(v) for v in middle),
            float(rng.uniform(0.0, TURN)),
        )

    def _sense(self, points: Array, session: Session) -> Array:
        up = np.array([np.cos(self.turn), np.sin(self.turn), 0.0])
        height = (points - np.array(self.centre)) @ up
        bent = (points[:, 2] / self.depth) ** 2 * np.exp(-height / self.height)
        return np.asarray(points + self.size * bent[:, None] * up)

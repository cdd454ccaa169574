r"""A body of metal near the field generator answers with a dipole's field of its own.

.. math:: \Delta p = \text{size}\; a^3 \left[\frac{3 r (r \cdot m)}{s^5} - \frac{m}{s^3}\right],
          \qquad r = p - c, \quad s^2 = |r|^2 + a^2

Franz, Haidegger, Birkfellner, Cleary, Peters and Maier-Hein (2014), IEEE Transactions on Medical
Imaging 33(8): conductive objects distort electromagnetic tracking.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.scene import Mechanism, Scene, Session
from plumbline.experiments.reality.unseen.chances import unit


@dataclass(frozen=True)
class FieldBody(Mechanism):
    """A dipole of strength `size` m at its own radius [m], its axis and place in device axes."""

    centre: tuple[float, ...] = (0.0, 0.0, 2.0)
    radius: float = 0.2
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    effect, limit, stage = "field_body", 0.05, "sensor"
    named = ("strength", "centre", "radius")
    depends_on = ("position",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> FieldBody:
        """Beside the cloud of tips."""
        points, _ = scene.pose_in_device()
        spread = float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
        centre = points[int(rng.integers(len(points)))] + 0.4 * spread * np.array(unit(rng))
        radius = spread * float(rng.uniform(0.3, 0.7))
        return cls(0.0, tuple(float(v) for v in centre), radius, unit(rng))

    def _sense(self, points: Array, session: Session) -> Array:
        r, m = points - np.array(self.centre), np.array(self.axis)
        s = np.sqrt(np.sum(r**2, axis=1, keepdims=True) + self.radius**2)
        field = 3.0 * r * (r @ m)[:, None] / s**5 - m / s**3
        return np.asarray(points + self.size * self.radius**3 * field)

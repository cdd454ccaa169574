r"""Near the end of its range a joint runs into its cushion and stops a little short.

.. math:: e = -s\, \text{size} \max(0, s (q - c) / h)^{1.5}, \qquad s = \pm 1

Merritt (1967), Hydraulic Control Systems, ch. 3: flow through a closing orifice; the pressure rises
faster than the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.unseen.chances import sign

HARDENING = 1.5


@dataclass(frozen=True)
class EndCushion(JointMechanism):
    """Short by `size` [rad or m] at the depth [rad or m] beyond where the cushion begins."""

    begins: float = 1.0
    depth: float = 0.5
    side: float = 1.0
    effect, limit, stage = "end_cushion", 0.02, "joint"
    named = ("short", "begins", "depth", "side")

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's own angle."""
        return (f"q{self.joint}",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> EndCushion:
        """Felt in the last tenth to quarter of the readings."""
        joint, side = int(rng.integers(1, scene.arm.joints + 1)), sign(rng)
        out = side * scene.session.q[:, joint - 1]
        begins = float(np.quantile(out, rng.uniform(0.75, 0.9)))
        return cls(0.0, joint, side * begins, max(float(out.max()) - begins, 1e-3), side)

    def _error(self, scene: Scene) -> Array:
        pressed = np.maximum(self.side * (self.reading(scene) - self.begins), 0.0) / self.depth
        return np.asarray(-self.side * self.size * pressed**HARDENING)

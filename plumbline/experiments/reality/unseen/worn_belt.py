r"""A run of worn teeth in a toothed belt: the pulley settles against one flank or the other.

.. math:: e = \text{size}\, \tanh(\tau / s) \cdot
          \tfrac12 [\tanh((q - a) / b) - \tanh((q - c) / b)]

Where the teeth are whole nothing happens; where they are worn the load picks the flank (Gates
2014, Light Power and Precision Manual, on tooth clearance and backlash of synchronous belts).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.unseen.chances import loaded, torques

EDGE = 0.05  # rad over which a worn tooth takes over from a whole one
PICKS = 0.15  # share of the largest load that seats the pulley


@dataclass(frozen=True)
class WornBelt(JointMechanism):
    """A clearance of `size` rad to each flank, worn from one angle to another [rad]."""

    largest: float = 1.0
    start: float = -0.5
    end: float = 0.5
    effect, limit, named, stage = "worn_belt", 0.02, ("clearance", "start", "end"), "joint"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's angle and load."""
        return f"q{self.joint}", f"load of q{self.joint}"

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> WornBelt:
        """A third to a half of the readings are on worn teeth."""
        joint, largest = loaded(scene, rng)
        low = float(rng.uniform(0.05, 0.5))
        high = low + float(rng.uniform(0.3, 0.45))
        start, end = np.quantile(scene.session.q[:, joint - 1], [low, high])
        return cls(0.0, joint, largest, float(start), float(end))

    def _error(self, scene: Scene) -> Array:
        q, torque = self.reading(scene), torques(scene)[:, self.joint - 1]
        worn = 0.5 * (np.tanh((q - self.start) / EDGE) - np.tanh((q - self.end) / EDGE))
        return np.asarray(self.size * np.tanh(torque / (PICKS * self.largest)) * worn)

r"""A pit in one tooth of the output gear: the joint falls in and climbs out.

.. math:: e = -\text{size} \exp(-(q - c)^2 / 2 w^2), \quad q - c \text{ wrapped to a turn}

Randall (1982), Journal of Mechanical Design 104(2), "A new method of modeling gear faults".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.unseen.chances import turning


@dataclass(frozen=True)
class GearPit(JointMechanism):
    """A dip of `size` rad, `width` rad wide at one sigma, at one angle [rad]."""

    centre: float = 0.0
    width: float = 0.1
    effect, limit, named, stage = "gear_pit", 0.01, ("depth", "centre", "width"), "joint"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's own angle."""
        return (f"q{self.joint}",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> GearPit:
        """Where some reading is, a seventh to a quarter of a radian wide."""
        joint = turning(scene, rng)
        centre = float(rng.choice(scene.session.q[:, joint - 1]))
        return cls(0.0, joint, centre, float(rng.uniform(0.07, 0.12)) * 2.0)

    def _error(self, scene: Scene) -> Array:
        away = np.angle(np.exp(1j * (self.reading(scene) - self.centre)))
        return np.asarray(-self.size * np.exp(-0.5 * (away / self.width) ** 2))

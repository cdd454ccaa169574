r"""A joint's zero wanders with the heat of its own motor: with how much it has moved of late.

.. math:: H \leftarrow H e^{-\Delta t / T} + |\Delta q|, \qquad e = \text{size}\; H / H_{max}

Heisel, Richter and Wurst (1997), CIRP Annals 46(1), "Thermal behaviour of industrial robots and
possibilities for error compensation".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.unseen.chances import seconds, turning


@dataclass(frozen=True)
class MotorHeat(JointMechanism):
    """`size` rad at the largest heat, counted in radians of way; cools with a constant [s]."""

    cooling: float = 100.0
    largest: float = 1.0
    effect, limit, named, stage = "motor_heat", 0.01, ("wander", "cooling"), "joint"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's past."""
        return (f"history of q{self.joint}",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> MotorHeat:
        """Cools within a twentieth to a fifth of the session."""
        trial = cls(0.0, turning(scene, rng), seconds(scene, 0.05, 0.2, rng))
        return cls(0.0, trial.joint, trial.cooling, float(trial._heat(scene).max()))

    def _heat(self, scene: Scene) -> Array:
        time = scene.session.time
        way = np.abs(np.diff(self.reading(scene), prepend=self.reading(scene)[:1]))
        heat = np.zeros(len(way))
        for k in range(1, len(way)):
            kept = heat[k - 1] * np.exp(-(time[k] - time[k - 1]) / self.cooling)
            heat[k] = kept + way[k]
        return heat

    def _error(self, scene: Scene) -> Array:
        return self.size * self._heat(scene) / self.largest

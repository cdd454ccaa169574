r"""A joint's axis nutates as it turns: the bearing runs out across the axis.

.. math:: \vartheta = \text{size}\, (\cos(k q + \varphi), \sin(k q + \varphi), 0)

ISO 230-7 (2015): tilt error motion of an axis of rotation. The cage turns at about 0.4 of
the ring's speed, so that the order k of its m balls is 0.4 m and no integer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen.chances import TURN, turning

CAGE = 0.4  # turns of the cage for one of the ring


@dataclass(frozen=True)
class BearingRunout(Mechanism):
    """A tilt of `size` rad across the axis of one joint, `order` times a turn."""

    joint: int = 1
    order: float = 1.2
    phase: float = 0.0
    effect, limit, named, stage = "bearing_runout", 0.01, ("tilt", "order", "phase"), "joint"

    @property
    def element(self) -> int | None:
        """The joint, from 1."""
        return self.joint

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's own angle."""
        return (f"q{self.joint}",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> BearingRunout:
        """Three to nine balls that are not alike."""
        order = CAGE * float(rng.choice([3, 4, 6, 7, 8, 9]))
        return cls(0.0, turning(scene, rng), order, float(rng.uniform(0.0, TURN)))

    def _body(self, scene: Scene) -> Scene:
        angle = self.order * scene.session.q[:, self.joint - 1] + self.phase
        tilt = self.size * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        if self.joint == 1:
            base = scene.base.copy()
            base[:, 3:5] += tilt
            return replace(scene, base=base)
        flex = scene.shape.flex.copy()
        flex[:, self.joint - 2, 3:5] += tilt
        return replace(scene, shape=replace(scene.shape, flex=flex))

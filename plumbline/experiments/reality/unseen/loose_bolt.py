r"""One bolt of the foot has lost its preload: the base opens once the moment exceeds what is left.

.. math:: \vartheta = \text{size} \max(0, M \cdot u - M_0) / (M_{max} - M_0) \text{ about } u

Below M_0 the joint is closed and stiff, above it the gap opens, to one side alone (Bickford 2008,
Introduction to the Design and Behavior of Bolted Joints: joint separation).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumbline.experiments.reality.arm import Array, loads
from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen.chances import TURN


@dataclass(frozen=True)
class LooseBolt(Mechanism):
    """An opening of `size` rad under the largest moment; moments in N m, `turn` in rad."""

    turn: float = 0.0  # of the axis u about the base's z
    preload: float = 0.0
    largest: float = 1.0
    effect, limit, named, stage = "loose_bolt", 0.01, ("opening", "turn", "preload"), "base"
    depends_on = ("posture",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> LooseBolt:
        """Open in a quarter to a half of the rows."""
        turn = float(rng.uniform(0.0, TURN))
        moment = cls(0.0, turn)._moment(scene)
        closed = float(np.quantile(moment, rng.uniform(0.5, 0.75)))
        return cls(0.0, turn, closed, float(moment.max()))

    def _moment(self, scene: Scene) -> Array:
        _, moment = loads(scene.arm, scene.frames())
        return np.asarray(moment[:, 0] @ [np.cos(self.turn), np.sin(self.turn), 0.0])

    def _body(self, scene: Scene) -> Scene:
        beyond = np.maximum(self._moment(scene) - self.preload, 0.0) / (self.largest - self.preload)
        base = scene.base.copy()
        base[:, 3] += self.size * beyond * np.cos(self.turn)
        base[:, 4] += self.size * beyond * np.sin(self.turn)
        return replace(scene, base=base)

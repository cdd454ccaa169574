r"""A door opens: the stand shrinks at once and comes back slowly.

.. math:: \text{twist} = \text{size}\; w\, [t \ge t_0]\, e^{-(t - t_0) / T}

ISO 230-3 (2020): the environment's temperature variation error; thin parts follow the air
within minutes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen.chances import seconds


@dataclass(frozen=True)
class Draught(Mechanism):
    """A twist of `size` times the weights [1, rad/m], from a moment on, fading [s]."""

    weights: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    moment: float = 0.0
    fading: float = 100.0
    effect, limit, named, stage = "draught", 0.02, ("size", "moment", "fading"), "base"
    depends_on = ("time",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Draught:
        """Within the session, over before it ends."""
        weights = rng.normal(size=6) * [1.0, 1.0, 1.0, 1.5, 1.5, 1.5]
        moment = float(scene.session.time[0]) + seconds(scene, 0.1, 0.6, rng)
        fading = seconds(scene, 0.05, 0.15, rng)
        return cls(0.0, tuple(float(w) for w in weights), moment, fading)

    def _body(self, scene: Scene) -> Scene:
        since = scene.session.time - self.moment
        course = np.where(since >= 0.0, np.exp(-np.maximum(since, 0.0) / self.fading), 0.0)
        moved = self.size * course[:, None] * np.array(self.weights)
        return replace(scene, base=scene.base + moved)

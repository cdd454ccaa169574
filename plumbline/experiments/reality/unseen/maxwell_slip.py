r"""Friction that winds up over travel and forgets slowly: four springs that slip one by one.

.. math:: z_m \leftarrow \operatorname{clip}(z_m + \Delta q, -w_m, w_m), \qquad
          e = -\text{size} \sum_m z_m / \sum_m w_m

Al-Bender, Lampaert and Swevers (2005), IEEE Transactions on Automatic Control 50(11): the
generalised Maxwell-slip model. The joint remembers its last turning points, not its last side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.unseen.chances import turning


@dataclass(frozen=True)
class MaxwellSlip(JointMechanism):
    """Wind-up of `size` rad once all springs slip; widths [rad] of travel until each one does."""

    widths: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0)
    effect, limit, named, stage = "maxwell_slip", 0.01, ("wind_up", "widths"), "joint"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's past."""
        return (f"history of q{self.joint}",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> MaxwellSlip:
        """Springs that slip after 0.2 to 3 rad."""
        widths = np.sort(np.exp(rng.uniform(np.log(0.2), np.log(3.0), 4)))
        return cls(0.0, turning(scene, rng), tuple(float(w) for w in widths))

    def _error(self, scene: Scene) -> Array:
        width = np.array(self.widths)
        travel = np.diff(self.reading(scene), prepend=self.reading(scene)[:1])
        wound, out = np.zeros(len(width)), np.empty(len(travel))
        for k, step in enumerate(travel):
            wound = np.clip(wound + step, -width, width)
            out[k] = wound.sum() / width.sum()
        return -self.size * out

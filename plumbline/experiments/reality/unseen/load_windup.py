r"""Gear friction in proportion to the load: the side of approach shows where the joint carries.

.. math:: e = -\text{size}\; d\, |\tau| / \tau_{max}, \qquad d = -1, 0, 1

Hamon, Gautier and Garrec (2010), IROS, "Dynamic identification of robots with a dry friction model
depending on load and velocity".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.unseen.chances import loaded, torques


@dataclass(frozen=True)
class LoadWindup(JointMechanism):
    """A wind-up of `size` rad to either side under the largest load [N m]."""

    largest: float = 1.0
    effect, limit, named, stage = "load_windup", 0.02, ("wind_up",), "joint"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's load and its side of approach."""
        return f"load of q{self.joint}", f"side of q{self.joint}"

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> LoadWindup:
        """Any loaded joint."""
        return cls(0.0, *loaded(scene, rng))

    def _error(self, scene: Scene) -> Array:
        share = np.abs(torques(scene)[:, self.joint - 1]) / self.largest
        return -self.size * share * scene.session.direction[:, self.joint - 1]

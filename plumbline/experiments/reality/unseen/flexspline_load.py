r"""A strain-wave drive whose twice-a-turn error grows with what it carries.

.. math:: e = \text{size}\, (\tau / \tau_{max}) \sin(2 q + \varphi)

The circular spline is not round, and the flexspline follows it the more the harder it is pressed:
Ghorbel, Gandhi and Alpeter (2001), Journal of Mechanical Design 123(1), "On the kinematic error in
harmonic drive gears", which shows the error change with the load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.unseen.chances import TURN, loaded, torques


@dataclass(frozen=True)
class FlexsplineLoad(JointMechanism):
    """An amplitude of `size` rad under the largest load [N m]."""

    largest: float = 1.0
    phase: float = 0.0
    effect, limit, named, stage = "flexspline_load", 0.01, ("amplitude", "phase"), "joint"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's angle and load."""
        return f"q{self.joint}", f"load of q{self.joint}"

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> FlexsplineLoad:
        """Any loaded joint, any phase."""
        return cls(0.0, *loaded(scene, rng), float(rng.uniform(0.0, TURN)))

    def _error(self, scene: Scene) -> Array:
        share = torques(scene)[:, self.joint - 1] / self.largest
        return self.size * share * np.sin(2.0 * self.reading(scene) + self.phase)

r"""A clamped hub slips on its shaft once, when the load has been largest, and stays there.

.. math:: e = \text{size}\, [k > k_s]

Budynas and Nisbett (2011), Shigley's Mechanical Engineering Design, sec. 7-7: the holding power of
set screws and clamps is a limit, and what slips does not come back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.unseen.chances import loaded, torques


@dataclass(frozen=True)
class HubSlip(JointMechanism):
    """A step of `size` rad in one joint after the time `moment` [s]."""

    moment: float = 0.0
    effect, limit, named, stage = "hub_slip", 0.02, ("slip", "moment"), "joint"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's past."""
        return (f"history of q{self.joint}",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> HubSlip:
        """At the largest load of the middle three fifths of the session."""
        joint, _ = loaded(scene, rng)
        rows = scene.session.rows
        middle = slice(rows // 5, rows - rows // 5)
        worst = int(np.abs(torques(scene)[middle, joint - 1]).argmax()) + middle.start
        return cls(0.0, joint, float(scene.session.time[worst]))

    def _error(self, scene: Scene) -> Array:
        return np.where(scene.session.time > self.moment, self.size, 0.0)

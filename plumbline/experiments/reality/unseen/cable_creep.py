r"""A cable that creeps under load: what it gives now is what it bore before.

.. math:: T \dot y = \tau - y, \qquad e = \text{size}\; y / \tau_{max}

The delayed part of a Kelvin-Voigt solid (Findley, Lai and Onaran 1976, Creep and Relaxation of
Nonlinear Viscoelastic Materials); the prompt part is taken to be compensated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.unseen.chances import loaded, torques


@dataclass(frozen=True)
class CableCreep(JointMechanism):
    """Stretch of `size` rad under the largest load [N m], with a time constant [s]."""

    largest: float = 1.0
    constant: float = 60.0
    effect, limit, named, stage = "cable_creep", 0.01, ("stretch", "constant"), "joint"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """What the joint bore."""
        return (f"history of q{self.joint}",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> CableCreep:
        """Forgets over two to eight readings."""
        joint, largest = loaded(scene, rng)
        step = float(np.median(np.diff(scene.session.time)))
        return cls(0.0, joint, largest, float(rng.uniform(2.0, 8.0)) * step)

    def _error(self, scene: Scene) -> Array:
        torque, time = torques(scene)[:, self.joint - 1], scene.session.time
        stretch = np.zeros(len(torque))
        for k in range(1, len(torque)):
            keep = np.exp(-(time[k] - time[k - 1]) / self.constant)
            stretch[k] = keep * stretch[k - 1] + (1.0 - keep) * torque[k]
        return self.size * stretch / self.largest

r"""An encoder that interpolates between its 2^k lines with unequal and shifted quadratures.

.. math:: e = \text{size}\,[\operatorname{atan2}((1 + b) \sin\theta + o, \cos\theta) - \theta],
          \qquad \theta = 2^k q

Heydemann (1981), Applied Optics 20(19): an offset o shows once a line, unequal gains b twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import GearRipple, JointMechanism
from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.unseen.chances import turning


@dataclass(frozen=True)
class EncoderInterpolation(JointMechanism):
    """`size` is the reading's weight: one over the lines of a true encoder, free here."""

    bits: int = 5
    offset: float = 0.2
    gain: float = 0.4
    effect, limit, stage = "encoder_interpolation", 0.1, "joint"
    named = ("weight", "bits", "offset", "gain")

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The joint's own angle."""
        return (f"q{self.joint}",)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> EncoderInterpolation:
        """Eight to 128 lines, both quadrature errors of like size."""
        offset = float(rng.uniform(0.15, 0.3))
        gain = offset * float(rng.uniform(1.6, 2.4))
        return cls(0.0, turning(scene, rng), int(rng.integers(3, 8)), offset, gain)

    def alike(self) -> tuple[tuple[Mechanism, ...], ...]:
        """Gears with one tooth a line, two, or both together are what a library may take it for."""
        once, twice = (
            tuple(GearRipple(1e-4, self.joint, order, phase) for phase in (0.0, np.pi / 2.0))
            for order in (2.0**self.bits, 2.0 ** (self.bits + 1))
        )
        return once, twice, (*once, *twice)

    def _error(self, scene: Scene) -> Array:
        angle = 2.0**self.bits * self.reading(scene)
        sine, cosine = (1.0 + self.gain) * np.sin(angle) + self.offset, np.cos(angle)
        seen = np.arctan2(sine, cosine)
        return np.asarray(self.size * np.angle(np.exp(1j * (seen - angle))))

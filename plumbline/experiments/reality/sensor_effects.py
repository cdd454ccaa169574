"""What goes wrong in the device that looks on: scale, distortion, and a patient who breathes."""

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.scene import Mechanism, Session

Vector = tuple[float, ...]


@dataclass(frozen=True)
class SensorScale(Mechanism):
    """The device's metre is off: p (1 + size), about its origin."""

    effect, limit, named = "sensor_scale", 0.02, ("scale",)

    def _sense(self, points: Array, session: Session) -> Array:
        return points * (1.0 + self.size)


@dataclass(frozen=True)
class SensorDistortion(Mechanism):
    """The device's optics bend space.

    `radial`: lateral coordinates grow by size rho^2, with rho the distance from the optical axis
    over the depth (Brown's first term). `depth`: points move along the line of sight by size times
    depth (a disparity offset of a stereo pair); size in 1/m.
    """

    form: str = "radial"
    effect, limit, named = "sensor_distortion", 0.3, ("coefficient", "form")

    def _sense(self, points: Array, session: Session) -> Array:
        depth = points[:, 2:]
        if self.form == "depth":
            return points * (1.0 + self.size * depth)
        bent = points.copy()
        squared = np.sum((points[:, :2] / depth) ** 2, axis=1, keepdims=True)
        bent[:, :2] *= 1.0 + self.size * squared
        return bent


@dataclass(frozen=True)
class Respiration(Mechanism):
    """What the device is tied to breathes on a ventilator.

    The displacement is size u (1 - cos^(2 n)(pi t / T + phase)). The dwell at one end makes it no
    sine (Lujan et al., 1999). Size is peak to peak [m], u in the device frame.
    """

    direction: Vector = (0.0, 0.0, 1.0)
    period: float = 4.0
    phase: float = 0.0
    power: int = 2
    effect, limit = "respiration", 0.03
    named = ("amplitude", "period", "direction", "phase", "power")

    def _sense(self, points: Array, session: Session) -> Array:
        angle = np.pi * session.time / self.period + self.phase
        breath = 1.0 - np.cos(angle) ** (2 * self.power)
        return np.asarray(points + self.size * breath[:, None] * np.array(self.direction))

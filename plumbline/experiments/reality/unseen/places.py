"""Mechanisms of a place that the library lacks: alike in any one socket."""

from dataclasses import replace
from typing import Self

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.chances import phase, spread, unit, vector
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.scene import Mechanism, Scene, Session

RANGES = Ranges("unseen")


class FieldBody(Mechanism):
    r"""A body of metal near the field generator answers with a dipole's field of its own.

    .. math:: \Delta p = \text{size}\; a^3 \left[\frac{3 r (r \cdot m)}{s^5} - \frac{m}{s^3}\right],
              \qquad r = p - c, \quad s^2 = |r|^2 + a^2

    Franz, Haidegger, Birkfellner, Cleary, Peters and Maier-Hein (2014), IEEE Transactions on
    Medical Imaging 33(8): conductive objects distort electromagnetic tracking.

    A dipole of strength `size` m at its own radius [m], its axis and place in device axes.
    """

    centre: tuple[float, ...] = (0.0, 0.0, 2.0)
    radius: float = 0.2
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Beside the cloud of tips."""
        points, _ = scene.pose_in_device()
        size = spread(points)
        centre = points[int(rng.integers(len(points)))] + 0.4 * size * np.array(unit(rng))
        return cls(0.0, vector(centre), size * RANGES.one("dipole", rng), unit(rng))

    def sense(self, points: Array, session: Session) -> Array:
        r, m = points - np.array(self.centre), np.array(self.axis)
        s = np.sqrt(np.sum(r**2, axis=1, keepdims=True) + self.radius**2)
        field = 3.0 * r * (r @ m)[:, None] / s**5 - m / s**3
        return np.asarray(points + self.size * self.radius**3 * field)


class HoseDrag(Mechanism):
    r"""A hose to the tool is slack near its anchor and pulls the tip back beyond its length.

    .. math:: \Delta p = \text{size} \max(0, (|p - a| - L) / L)\, (a - p) / |a - p|

    Irvine (1981), Cable Structures: a cable bears nothing until its sag is used up.

    A pull of `size` m at twice the hose's length [m]; the anchor [m] in the base frame.
    """

    anchor: tuple[float, ...] = (0.0, 0.0, 1.0)
    length: float = 0.5

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """Hung beside the cloud of tips, taut in a third to a half of the rows."""
        _, tips = scene.tip()
        anchor = tips.mean(axis=0) + spread(tips) * np.array(unit(rng))
        away = np.linalg.norm(tips - anchor, axis=1)
        return cls(0.0, vector(anchor), float(np.quantile(away, RANGES.one("slack", rng))))

    def body(self, scene: Scene) -> Scene:
        _, tips = scene.tip()
        back = np.array(self.anchor) - tips
        away = np.linalg.norm(back, axis=1, keepdims=True)
        pull = np.maximum(away - self.length, 0.0) / self.length
        return replace(scene, sag=scene.sag + self.size * pull * back / away)


class StitchedVolume(Mechanism):
    r"""A measuring volume stitched from two stations: beyond the seam everything is shifted.

    .. math:: \Delta p = \text{size}\; u\, [(p - c) \cdot n > 0]

    Predmore (2010), Precision Engineering 34(1), on bundling several stations of a tracker: what
    their common points leave over is a step between them.

    A step of `size` m along `way` behind a seam, all in the device's axes [m].
    """

    seam: tuple[float, ...] = (0.0, 0.0, 2.0)
    normal: tuple[float, ...] = (1.0, 0.0, 0.0)
    way: tuple[float, ...] = (0.0, 0.0, 1.0)

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """A seam through the cloud of tips."""
        points, _ = scene.pose_in_device()
        seam = points.mean(axis=0) + points.std(axis=0) * RANGES.near("seam", rng, 3)
        return cls(0.0, vector(seam), unit(rng), unit(rng))

    def sense(self, points: Array, session: Session) -> Array:
        behind = (points - np.array(self.seam)) @ np.array(self.normal) > 0.0
        return np.asarray(points + self.size * behind[:, None] * np.array(self.way))


class TrackerRefraction(Mechanism):
    r"""Warm air over the floor bends the tracker's line of sight, the more the lower and farther.

    .. math:: \Delta p = \text{size}\, (z / z_0)^2 \exp(-h / h_0)\, d, \qquad h = (p - c) \cdot d

    A gradient of the refractive index curves a ray, whose end is missed by half the curvature times
    the square of the way (Estler, Edmundson, Peggs and Parker 2002, CIRP Annals 51(2)); the
    gradient fades with height.

    A miss of `size` m at the mean depth [m] and height; `turn` [rad] says where up is.
    """

    depth: float = 2.0
    height: float = 0.5
    centre: tuple[float, ...] = (0.0, 0.0, 2.0)
    turn: float = 0.0

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> Self:
        """A layer about as high as the cloud of tips."""
        points, _ = scene.pose_in_device()
        middle = points.mean(axis=0)
        height = float(np.sqrt(np.mean((points - middle) ** 2))) * RANGES.one("layer", rng)
        return cls(0.0, float(middle[2]), height, vector(middle), phase(rng))

    def sense(self, points: Array, session: Session) -> Array:
        up = np.array([np.cos(self.turn), np.sin(self.turn), 0.0])
        height = (points - np.array(self.centre)) @ up
        bent = (points[:, 2] / self.depth) ** 2 * np.exp(-height / self.height)
        return np.asarray(points + self.size * bent[:, None] * up)

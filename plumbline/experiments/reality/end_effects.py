"""What goes wrong beyond the flange: with the tool, and in the device that looks at it.

A clamp that slips, a needle that hangs or is pushed aside; a scale, a distortion, a patient who
breathes.
"""

from dataclasses import replace

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.scene import Mechanism, Scene, Session

Vector = tuple[float, ...]


class ToolSlip(Mechanism):
    """The tool sits elsewhere from one moment on, or anew in each group: tool + size w_g [m].

    `weights` has a row for each stretch of the session, of which the first is not moved; stretches
    end at `moments`, parts of the session, or with the groups where there are none.
    """

    weights: tuple[Vector, ...] = ((1.0, 0.0, 0.0),)
    moments: Vector = ()

    def body(self, scene: Scene) -> Scene:
        session = scene.session
        stretch = np.searchsorted(np.asarray(self.moments), session.progress, side="right")
        if not self.moments:
            stretch = (session.group - session.group[0]).astype(int)
        places = np.vstack([np.zeros(3), np.array(self.weights)])
        stretch = np.minimum(stretch, len(places) - 1)
        return replace(scene, tool=scene.tool + self.size * places[stretch])

    def parameters(self) -> dict[str, object]:
        """Shifts of the later stretches [m], and when they begin."""
        shifts = [[self.size * w for w in row] for row in self.weights]
        return {"shifts": shifts, "moments": list(self.moments)}


class NeedleSag(Mechanism):
    """The needle hangs: the tip moves by size along the part of gravity across the needle.

    `size` is the sag [m] when the needle lies level; `axis` is the needle's direction in the flange
    frame.
    """

    axis: Vector = (0.0, 0.0, 1.0)

    def body(self, scene: Scene) -> Scene:
        along = scene.frames()[:, -1, :3, :3] @ np.array(self.axis)
        down = scene.arm.gravity / np.linalg.norm(scene.arm.gravity)
        across = down - along * (along @ down)[:, None]
        return replace(scene, sag=scene.sag + self.size * across)


class NeedleBending(Mechanism):
    """A force F on the tip bends the needle: the tip moves by size (F - a a.F), size in m/N.

    As a rod held at the flange it turns by 3/2 of that over its length, about a x F.
    """

    axis: Vector = (0.0, 0.0, 1.0)

    def body(self, scene: Scene) -> Scene:
        if scene.session.force is None:
            raise PlumblineError("needle_bending without forces: record them")
        axis, force = np.array(self.axis), scene.session.force
        across = self.size * (force - np.outer(force @ axis, axis))
        length = float(np.linalg.norm(scene.tool[0]))
        return replace(
            scene, tool=scene.tool + across, turn=scene.turn + 1.5 / length * np.cross(axis, across)
        )


class SensorScale(Mechanism):
    """The device's metre is off: p (1 + size), about its origin."""

    def sense(self, points: Array, session: Session) -> Array:
        return points * (1.0 + self.size)


class SensorDistortion(Mechanism):
    """The device's optics bend space.

    `radial`: lateral coordinates grow by size rho^2, with rho the distance from the optical axis
    over the depth (Brown's first term). `depth`: points move along the line of sight by size times
    depth (a disparity offset of a stereo pair); size in 1/m.
    """

    form: str = "radial"

    def sense(self, points: Array, session: Session) -> Array:
        depth = points[:, 2:]
        if self.form == "depth":
            return points * (1.0 + self.size * depth)
        bent = points.copy()
        squared = np.sum((points[:, :2] / depth) ** 2, axis=1, keepdims=True)
        bent[:, :2] *= 1.0 + self.size * squared
        return bent


class Respiration(Mechanism):
    """What the device is tied to breathes on a ventilator.

    The displacement is size u (1 - cos^(2 n)(pi t / T + phase)). The dwell at one end makes it no
    sine (Lujan et al., 1999). Size is peak to peak [m], u in the device frame.
    """

    direction: Vector = (0.0, 0.0, 1.0)
    period: float = 4.0
    phase: float = 0.0
    power: int = 2

    def sense(self, points: Array, session: Session) -> Array:
        angle = np.pi * session.time / self.period + self.phase
        breath = 1.0 - np.cos(angle) ** (2 * self.power)
        return np.asarray(points + self.size * breath[:, None] * np.array(self.direction))

r"""A link heated on one side bows, until the heat has soaked through.

.. math:: \vartheta = \text{size}\, (T_{near} - T_{far}) / \Delta T, \qquad
          \text{shift} = \tfrac12 L \vartheta

The far side lags behind the near one; a free beam with a linear difference across it bends to a
constant curvature (Boley and Weiner 1960, Theory of Thermal Stresses).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumbline.experiments.reality.body_effects import LinkMechanism, link_vector
from plumbline.experiments.reality.scene import Scene
from plumbline.experiments.reality.session import lagged
from plumbline.experiments.reality.unseen.chances import seconds, unit


@dataclass(frozen=True)
class ThermalBow(LinkMechanism):
    """An end rotation of `size` rad for the difference `rise` [K]; the far side lags [s]."""

    rise: float = 10.0
    delay: float = 200.0
    side: tuple[float, ...] = (0.0, 1.0, 0.0)  # towards the heat, in the link's frame
    effect, limit, named, stage = "thermal_bow", 0.01, ("rotation", "delay"), "link"
    depends_on = ("time", "temperature")

    @classmethod
    def drawn(cls, scene: Scene, rng: np.random.Generator) -> ThermalBow:
        """A long link; heat that takes a tenth to three tenths of the session to soak through."""
        long = [
            i + 1
            for i in range(scene.arm.joints)
            if np.linalg.norm(link_vector(scene, i)[0]) > 0.12 and not scene.arm.prismatic[i]
        ]
        link = int(rng.choice(long))
        along = link_vector(scene, link - 1)[0]
        side = np.cross(along, unit(rng))
        side /= np.linalg.norm(side)
        rise = float(np.ptp(scene.session.warmth))
        return cls(0.0, link, rise, seconds(scene, 0.1, 0.3, rng), tuple(map(float, side)))

    def _body(self, scene: Scene) -> Scene:
        session, i = scene.session, self.link - 1
        across = session.warmth - lagged(session.time, session.warmth, self.delay)
        along, side = link_vector(scene, i)[0], np.array(self.side)
        length = float(np.linalg.norm(along))
        bend = np.concatenate([-0.5 * length * side, np.cross(side, along / length)])
        flex = scene.shape.flex.copy()
        flex[:, i] += self.size * (across / self.rise)[:, None] * bend
        return replace(scene, shape=replace(scene.shape, flex=flex))

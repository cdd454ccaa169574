"""Mechanisms of the real world for which nobody wrote an effect.

Each says on what it truly depends (`depends_on`), so that a diagnosis which only says "something
else" can still be held to where that something lives.
"""

from dataclasses import replace

import numpy as np

from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.scene import Mechanism, Scene, Session

RANGES = Ranges("library")
Vector = tuple[float, ...]


class CrossRipple(JointMechanism):
    """Tooth ripple tied to a second joint: e = size sin(order q_j + mesh q_k + phase) [rad]."""

    other: int = 1
    order: float = 3.0
    mesh: float = 2.0
    phase: float = 0.0

    def _error(self, scene: Scene) -> Array:
        q, other = self.reading(scene), scene.session.q[:, self.other - 1]
        return self.size * np.sin(self.order * q + self.mesh * other + self.phase)


class MagneticSpot(Mechanism):
    """A field around one spot bends the device's reading: size u exp(-|p - c|^2 / (2 w^2)) [m]."""

    centre: Vector = (0.0, 0.0, 0.0)
    width: float = 0.1
    direction: Vector = (0.0, 0.0, 1.0)

    def sense(self, points: Array, session: Session) -> Array:
        squared = np.sum((points - np.array(self.centre)) ** 2, axis=1)
        bump = np.exp(-0.5 * squared / self.width**2)
        return np.asarray(points + self.size * bump[:, None] * np.array(self.direction))


class StickSlip(JointMechanism):
    """The joint sticks and lets go: the error winds up with travel, then jumps.

    e_k = e_{k-1} - size dq_k, and when |e_k| passes size times the next random threshold the
    joint slips to a random share of it. The outcome depends on everything that went before.
    """

    seed: int = 0

    def _error(self, scene: Scene) -> Array:
        rng = np.random.default_rng(self.seed)
        travel = self.travel(scene)
        wound, threshold, out = 0.0, RANGES.one("grip", rng), np.empty(len(travel))
        for k, step in enumerate(travel):
            wound += float(step)
            if abs(wound) > threshold:
                wound = RANGES.one("jump", rng) * threshold
                threshold = RANGES.one("grip", rng)
            out[k] = -wound
        return self.size * out


class LooseTool(Mechanism):
    """On three readings the tool sat elsewhere in its clamp: tool + size u [m] on those rows."""

    rows: tuple[int, ...] = (0, 1, 2)
    direction: Vector = (0.0, 0.0, 1.0)

    def body(self, scene: Scene) -> Scene:
        tool = scene.tool.copy()
        tool[list(self.rows)] += self.size * np.array(self.direction)
        return replace(scene, tool=tool)

    def parameters(self) -> dict[str, object]:
        """Slip [m] and the rows, the header being row 1, where it shows."""
        rows = [r + 2 for r in self.rows]
        return {"slip": self.size, "rows": rows, "depends_on": list(self.depends_on)}

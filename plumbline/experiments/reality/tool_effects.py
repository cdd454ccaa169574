"""What goes wrong with the tool: a clamp that slips, a needle that hangs or is pushed aside."""

from dataclasses import dataclass, replace

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.scene import Mechanism, Scene

Vector = tuple[float, ...]


@dataclass(frozen=True)
class ToolSlip(Mechanism):
    """The tool sits elsewhere from one moment on, or anew in each group: tool + size w_g [m].

    `weights` has a row for each stretch of the session, of which the first is not moved; stretches
    end at `moments`, parts of the session, or with the groups where there are none.
    """

    weights: tuple[Vector, ...] = ((1.0, 0.0, 0.0),)
    moments: Vector = ()
    effect, limit = "tool_slip", 0.02

    def _body(self, scene: Scene) -> Scene:
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


@dataclass(frozen=True)
class NeedleSag(Mechanism):
    """The needle hangs: the tip moves by size along the part of gravity across the needle.

    `size` is the sag [m] when the needle lies level; `axis` is the needle's direction in the flange
    frame.
    """

    axis: Vector = (0.0, 0.0, 1.0)
    effect, limit, named = "needle_sag", 0.02, ("sag",)

    def _body(self, scene: Scene) -> Scene:
        along = scene.frames()[:, -1, :3, :3] @ np.array(self.axis)
        down = scene.arm.gravity / np.linalg.norm(scene.arm.gravity)
        across = down - along * (along @ down)[:, None]
        return replace(scene, sag=scene.sag + self.size * across)


@dataclass(frozen=True)
class NeedleBending(Mechanism):
    """A force F on the tip bends the needle: the tip moves by size (F - a a.F), size in m/N.

    As a rod held at the flange it turns by 3/2 of that over its length, about a x F.
    """

    axis: Vector = (0.0, 0.0, 1.0)
    effect, limit, typical, named = "needle_bending", 0.02, 1e-4, ("compliance",)

    def _body(self, scene: Scene) -> Scene:
        if scene.session.force is None:
            raise PlumblineError("needle_bending without forces: record them")
        axis, force = np.array(self.axis), scene.session.force
        across = self.size * (force - np.outer(force @ axis, axis))
        length = float(np.linalg.norm(scene.tool[0]))
        return replace(
            scene, tool=scene.tool + across, turn=scene.turn + 1.5 / length * np.cross(axis, across)
        )

r"""Gravity points elsewhere than stated: a base that is not level, or a robot on a wall.

.. math:: g \leftarrow R(\alpha u + \beta w)\, g, \qquad u, w, g \text{ at right angles}
"""

from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects.drive import TORQUES
from plumbline.kinematics.effects.effect import Effect, Stage, State
from plumbline.kinematics.frames import constant, rotation
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class GravityDirection(Effect):
    """Two turns of gravity in the base frame; one about gravity itself would change nothing."""

    depends_on = "load"
    name = "gravity_direction"
    stage = Stage.ACTUATION
    acts_at = Stage.BASE
    observations = TORQUES
    needs_gravity = True
    words = "gravity points elsewhere in the robot's base than stated: the base is not level"
    reference = "Featherstone (2008), Rigid Body Dynamics Algorithms, sec. 5.3 (gravity)"
    source = "by hand: a floor or stand out of level by a degree; the bound is another mounting"
    first = Parameter("rad", -1.0, 1.0, scale=0.02, doc="turn about x, for a gravity along z")
    second = Parameter("rad", -1.0, 1.0, scale=0.02, doc="turn about y, for a gravity along z")

    def apply(self, state: State, *values: cs.SX) -> State:
        u, w = level_axes(state.chain.gravity)
        turn = values[0] * constant(u) + values[1] * constant(w)
        return replace(state, gravity=rotation(turn) @ state.gravity)


def level_axes(gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (3,) at right angles to gravity; x and y for a gravity along z."""
    down = gravity / np.linalg.norm(gravity)
    least = np.argsort(np.abs(down), kind="stable")[0]
    u = np.eye(3)[least] - down[least] * down
    u = u / np.linalg.norm(u)
    w = np.cross(u, down)
    return u, w if w[int(np.argmax(np.abs(w)))] > 0 else -w

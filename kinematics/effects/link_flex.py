r"""A link bends sideways under the weight that it carries, as an end-loaded cantilever.

.. math:: \delta = f\, F_\perp, \qquad \varphi = \frac{3 f}{2 L}\, u \times F_\perp

with f = L^3 / (3 E I) for a slender beam of length L along u (Timoshenko 1955, Strength of
Materials I, sec. 20), and F the weight of all bodies beyond the link.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from kinematics.effects.effect import Array, Effect, Scope, Stage, State
from kinematics.frames import Transform, constant
from kinematics.parameters import Parameter

SHORTEST = 0.05


@dataclass(frozen=True)
class LinkFlex(Effect):
    """Lateral bending of one link under gravity."""

    link: int = 1

    name = "link_flex"
    stage = Stage.LINK
    words = "link {element} bends under the weight that it carries"
    reference = "Timoshenko (1955), Strength of Materials I, sec. 20"
    flexibility = Parameter("m/N", 0.0, 1e-4, scale=1e-6, doc="deflection of its end per force")

    @property
    def element(self) -> int | None:
        """The link's number."""
        return self.link

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """Every link longer than 5 cm that a joint can tilt against gravity."""
        if not cls.fits(scope) or not scope.chain.gravity.any():
            return []
        lengths = [np.linalg.norm(_beam(scope, i)) for i in range(1, scope.chain.n + 1)]
        return [cls(link=i) for i, length in enumerate(lengths, start=1) if length > SHORTEST]

    def apply(self, state: State, *values: cs.SX) -> State:
        """Shift and tilt the link's far end, in the frame of the joint that carries it."""
        beam = state.placements[self.link].t
        T = state.nominal_frames()[self.link - 1]
        force = T.R.T @ state.gravity_direction() * _carried(state, self.link)
        length2 = cs.sumsqr(beam)
        across = force - beam * cs.dot(beam, force) / length2
        turn = 1.5 * values[0] / length2 * cs.cross(beam, across)
        bent = Transform(cs.SX.eye(3), beam + values[0] * across)
        back = Transform.from_twist(cs.SX(3, 1), turn)
        placements = list(state.placements)
        placements[self.link] = bent @ back @ Transform(placements[self.link].R, cs.SX(3, 1))
        return replace(state, placements=tuple(placements))


def _beam(scope: Scope, link: int) -> Array:
    joints = scope.chain.joints
    T = joints[link].T_parent_joint if link < len(joints) else scope.chain.T_last_tip
    return np.asarray(T[:3, 3])


def _carried(state: State, link: int) -> cs.SX:
    """Weight [N] of all bodies beyond the link and of the payload."""
    size = float(np.linalg.norm(state.chain.gravity))
    mass = sum(joint.mass for joint in state.chain.joints[link:])
    return constant([size]) * (mass + state.row.get("payload", cs.SX(0)))

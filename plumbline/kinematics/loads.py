r"""What gravity asks of a part of the arm: the weight of all that it carries, and its moment.

.. math:: F = \sum_{k \ge i} m_k\, g, \qquad M = \sum_{k \ge i} (p_k - o) \times m_k\, g

over the bodies from joint i outwards and the payload at the tip.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as cs

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.frames import Transform, constant


@dataclass(frozen=True, eq=False)
class Nominal:
    """The nominal arm at the joint readings, worked out once and shared by all effects.

    Taken at the readings, not at the deflected posture: the difference is of second order.
    """

    chain: Chain  #: the nominal chain
    q: cs.SX  #: joint readings (n,) [rad or m]
    payload: cs.SX  #: known payload [kg]

    @cached_property
    def load(self) -> cs.SX:
        """Torque (n,) that the drives hold against gravity [N m or N]."""
        return self.chain.gravity_torque(self.q, self.payload)

    @cached_property
    def frames(self) -> list[Transform]:
        """``T_base_joint`` of every joint and last the tip (n + 1)."""
        return self.chain.joint_frames(self.q)

    def load_at(self, place: cs.SX) -> cs.SX:
        """Torque (n,) that one kilogram at a place (3,) of the base frame asks [N m or N]."""
        return cs.gradient(-cs.dot(place, constant(self.chain.gravity)), self.q)


def weight_beyond(arm: Nominal, joint: int, about: cs.SX) -> tuple[cs.SX, cs.SX]:
    """Force (3,) [N] and moment (3,) [N m] of all weights from a joint outwards, in the base frame.

    Args:
        arm: The arm at its posture.
        joint: The first joint, from 1, whose body counts.
        about: The point (3,) that the moment is about [m].
    """
    g = constant(arm.chain.gravity)
    force = arm.payload * g
    moment = cs.cross(arm.frames[-1].t - about, force)
    for body, T in zip(arm.chain.joints[joint - 1 :], arm.frames[joint - 1 :], strict=False):
        if body.mass > 0.0:
            force += body.mass * g
            moment += cs.cross(T.point(constant(body.com)) - about, body.mass * g)
    return force, moment

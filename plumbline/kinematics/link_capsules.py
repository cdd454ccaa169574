"""Capsules along the bones of a robot, from each joint to the next; lengths are in m."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.kinematics.capsules import Segment
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.frames import Transform, constant

SHORTEST = 1e-3  # [m] of a bone that gets a capsule


@dataclass(frozen=True, eq=False)
class LinkCapsule:
    """A capsule that moves with a joint of a chain."""

    joint: int  # number of the joint that carries it, from 0; -1 for the base
    ends: Array  # both ends of its axis (2, 3) in that joint's frame [m]
    radius: float  # its radius [m]
    name: str  # of the link

    def axis(self, frames: Sequence[Transform]) -> Segment:
        """Its axis in the base frame [m], given ``chain.joint_frames(q)``."""
        a, b = (constant(end) for end in self.ends)
        if self.joint < 0:
            return Segment(a, b)
        return Segment(frames[self.joint].point(a), frames[self.joint].point(b))


def bones(chain: Chain, radius: float, skip: Sequence[int] = ()) -> tuple[LinkCapsule, ...]:
    """Capsules from every joint to the next, and from the last to the tip.

    Args:
        chain: The arm.
        radius: Of all capsules [m].
        skip: Joints (from 0; -1 for the base) whose link gets none.
    """
    nexts = [joint.T_parent_joint[:3, 3] for joint in chain.joints] + [chain.T_last_tip[:3, 3]]
    names = ["base", *chain.joint_names]
    found = []
    for k, end in enumerate(nexts):
        if k - 1 not in skip and np.linalg.norm(end) > SHORTEST:
            found.append(LinkCapsule(k - 1, np.stack([np.zeros(3), end]), radius, names[k]))
    return tuple(found)

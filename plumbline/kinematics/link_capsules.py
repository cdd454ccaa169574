r"""Capsules around the links of a robot: from its URDF's collision geometry, or along its bones.

A URDF's cylinder of length l and radius r along its own z is covered by the capsule from
:math:`-l/2` to :math:`l/2` with the radius r, a sphere by itself, a box of half sizes
:math:`h_1 \ge h_2 \ge h_3` by the capsule along its longest edge,

.. math:: a, b = \mp h_1 e_1, \qquad r = \sqrt{h_2^2 + h_3^2}

A mesh is not looked into: it is refused, with its name. Where there is no geometry, bones are
capsules from each joint to the next. Lengths are in m, as everywhere in kinematics.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from plumbline.errors import PlumblineError
from plumbline.kinematics.capsules import Segment
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.frames import Transform, constant
from plumbline.kinematics.link_export import origin_of
from plumbline.kinematics.robot import Robot

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


def from_urdf(robot: Robot, chain: Chain) -> tuple[LinkCapsule, ...]:
    """Capsules around the collision geometry of a URDF's links, as far as the chain moves them.

    Raises:
        PlumblineError: The robot did not come from a URDF, or a shape is a mesh.
    """
    if robot.urdf is None:
        raise PlumblineError(
            f"{robot.name}: no URDF, so no collision geometry; use bones(chain, ...)"
        )
    found = []
    for link in ET.fromstring(robot.urdf).iter("link"):
        name = link.get("name", "")
        if not chain.model.existFrame(name):
            continue
        frame = chain.model.frames[chain.model.getFrameId(name, pin.FrameType.BODY)]
        for shape in link.iter("collision"):
            ends, radius = _capsule(shape, name)
            T = frame.placement.homogeneous @ origin_of(shape)
            placed = ends @ T[:3, :3].T + T[:3, 3]
            found.append(LinkCapsule(frame.parentJoint - 1, placed, radius, name))
    return tuple(found)


def _capsule(shape: ET.Element, name: str) -> tuple[Array, float]:
    """Ends (2, 3) and radius [m] around a collision shape, in its own frame."""
    geometry = shape.find("geometry")
    body = geometry[0] if geometry is not None and len(geometry) else None
    kind = "nothing" if body is None else body.tag
    if body is not None and kind in ("cylinder", "capsule"):
        half = float(body.get("length", 0.0)) / 2
        return np.array([[0, 0, -half], [0, 0, half]]), float(body.get("radius", 0.0))
    if body is not None and kind == "sphere":
        return np.zeros((2, 3)), float(body.get("radius", 0.0))
    if body is not None and kind == "box":
        half_sizes = np.array([float(word) for word in body.get("size", "0 0 0").split()]) / 2
        longest = int(np.argmax(half_sizes))
        end = np.zeros(3)
        end[longest] = half_sizes[longest]
        return np.stack([-end, end]), float(np.linalg.norm(np.delete(half_sizes, longest)))
    raise PlumblineError(
        f"link {name!r}: collision geometry {kind!r}, expected cylinder, sphere, box or capsule; "
        "replace it, or use bones(chain, ...)"
    )

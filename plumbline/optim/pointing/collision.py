"""Capsules that move with a posture: the arm's links, the needle, and the way it will be driven.

The arm is a chain of capsules from joint to joint: first along a joint's axis, then along the
normal to the next joint, as arms mostly are built. The needle is a capsule from flange to tip, its
path one from the tip to the lesion.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as cs
import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import constant
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing.aim import Aim
from plumbline.optim.pointing.needle import Needle


def corners(chain: Chain, q: cs.SX) -> cs.SX:
    """Points (3, 2 n + 2) along the arm at a posture: origins, and corners between them [m]."""
    frames = chain.joint_frames(q)
    points = [cs.SX(3, 1)]
    for joint, T, following in zip(chain.joints, frames, frames[1:], strict=False):
        axis = T.R @ constant(joint.axis[:, None])
        points += [T.t, T.t + axis * cs.dot(axis, following.t - T.t)]
    points.append(frames[-1].t)
    return cs.horzcat(*points)


@lru_cache(maxsize=16)
def _points(chain: Chain) -> cs.Function:
    """The corners, and last the flange's axes as columns (3, 2 n + 5)."""
    q = cs.SX.sym("q", chain.n)
    return cs.Function(
        "points", [q], [cs.densify(cs.horzcat(corners(chain, q), chain.forward(q).R))]
    )


def links(chain: Chain, q: Array) -> Array:
    """Axes of the arm's capsules (N, 2 n + 1, 2, 3) at postures (N, n), base frame [m]."""
    return _links(over_rows(_points(chain), q)[0])


def _links(points: Array) -> Array:
    return np.stack([points[:, :-4], points[:, 1:-3]], axis=2)


def link_names(chain: Chain) -> tuple[str, ...]:
    """What the arm's capsules are called (2 n + 1): two a joint, after that of the base."""
    return ("link base", *(f"link {name}" for name in chain.joint_names for _ in range(2)))


def radii(aim: Aim) -> Array:
    """Radii (2 n + 3,) of all capsules: links, needle, path [m]."""
    arm = np.full(2 * aim.chain.n + 1, aim.arm_radius)
    return np.append(arm, [aim.needle.radius, aim.needle.radius])


def moving(chain: Chain, held: Needle, q: Array) -> Array:
    """Axes of all capsules (N, 2 n + 3, 2, 3) at postures (N, n): links, needle, path [m]."""
    points = over_rows(_points(chain), q)[0]
    # Columns of R come as rows: the flange's axes in the base frame.
    along = np.einsum("nji,j->ni", points[:, -3:], np.asarray(held.axis))
    top = points[:, -4]
    tip, centre = top + held.length * along, top + held.reach * along
    return _with_needle(_links(points), tip, top, centre)


def pointed(aim: Aim, q: Array, theta: Array, beta: Array) -> Array:
    """The same (N, 2 n + 3, 2, 3) with the needle where angles (N,) put it; links may be NaN."""
    u = aim.outward(theta, beta)
    tip, top = (aim.target + length * u for length in (aim.needle.standoff, aim.needle.reach))
    arm = np.full((len(q), 2 * aim.chain.n + 1, 2, 3), np.nan)
    there = np.isfinite(q).all(axis=1)
    arm[there] = links(aim.chain, q[there])
    return _with_needle(arm, tip, top, np.broadcast_to(aim.target, tip.shape))


def _with_needle(arm: Array, tip: Array, top: Array, centre: Array) -> Array:
    needle, path = np.stack([tip, top], axis=1), np.stack([centre, tip], axis=1)
    return np.concatenate([arm, needle[:, None], path[:, None]], axis=1)

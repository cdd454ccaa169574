"""How far arm and needle stay from a body, by coal; everything in millimetres there.

The arm is a chain of capsules from joint to joint: first along a joint's axis, then along the
normal to the next joint, as arms mostly are built. The needle is a capsule from flange to tip.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as cs
import coal
import numpy as np

from kinematics.chain import Chain
from kinematics.evaluate import over_rows
from kinematics.frames import constant
from optim.pointing.aim import Aim
from optim.pointing.body import MM, turning_z_to
from optim.pointing.faults import Array

SHORTEST = 1e-6  # [m]: links shorter than this have no capsule of their own


@lru_cache(maxsize=16)
def _corners(chain: Chain) -> cs.Function:
    """Points (3, 2 n + 2) along the arm at a posture: origins, and corners between them."""
    q = cs.SX.sym("q", chain.n)
    frames = chain.joint_frames(q)
    points = [cs.SX(3, 1)]
    for joint, T, following in zip(chain.joints, frames, frames[1:], strict=False):
        axis = T.R @ constant(joint.axis[:, None])
        points += [T.t, T.t + axis * cs.dot(axis, following.t - T.t)]
    points.append(frames[-1].t)
    return cs.Function("corners", [q], [cs.densify(cs.horzcat(*points))])


def links(chain: Chain, q: Array) -> Array:
    """Axes of the arm's capsules (N, 2 n + 1, 2, 3) at postures (N, n), base frame [m]."""
    points = over_rows(_corners(chain), q)[0]
    return np.stack([points[:, :-1], points[:, 1:]], axis=2)


def clearances(aim: Aim, q: Array, theta: Array, beta: Array) -> tuple[Array, Array]:
    """Distance of the arm and of the needle from the body, below 0 where they go into it.

    Args:
        aim: The arm, its needle and the body.
        q: Postures that hold the needle (N, n).
        theta: Puncture angles (N,) [rad].
        beta: Azimuths (N,) [rad].

    Returns:
        Of the arm and of the needle, each (N,) [m]; infinite where there is no body.
    """
    count = len(q)
    if aim.body is None or not count:
        return np.full(count, np.inf), np.full(count, np.inf)
    T = aim.T_robot_ct @ aim.body.T_ct_body
    body = coal.CollisionObject(aim.body.shape(), T[:3, :3], MM * T[:3, 3])
    u = aim.outward(theta, beta)
    needle = np.stack(
        [aim.target + aim.needle.standoff * u, aim.target + aim.needle.reach * u], axis=1
    )[:, None]
    around = (T[:3, 3], aim.body.half_size)
    arm = _nearest(body, around, links(aim.chain, q), aim.arm_radius)
    return arm, _nearest(body, around, needle, aim.needle.radius)


def _nearest(
    body: coal.CollisionObject, around: tuple[Array, float], segments: Array, radius: float
) -> Array:
    """Least signed distance (N,) [m] between a body and the capsules about segments (N, M, 2, 3).

    Capsules that cannot be the nearest, by the sphere around the body and their own, are left out.
    """
    lengths = np.linalg.norm(segments[:, :, 1] - segments[:, :, 0], axis=2)
    away = np.linalg.norm(segments.mean(axis=2) - around[0], axis=2)
    at_least = np.where(lengths > SHORTEST, away - lengths / 2 - around[1] - radius, np.inf)
    found = np.full(len(segments), np.inf)
    for k, order in enumerate(np.argsort(at_least, axis=1)):
        for i in order:
            if at_least[k, i] >= found[k]:
                break
            found[k] = min(found[k], _gap(body, segments[k, i], radius))
    return found


def _gap(body: coal.CollisionObject, segment: Array, radius: float) -> float:
    """Signed distance [m] between the body and a capsule about a segment (2, 3) [m]."""
    along = segment[1] - segment[0]
    capsule = coal.CollisionObject(
        coal.Capsule(MM * radius, MM * float(np.linalg.norm(along))),
        turning_z_to(along),
        MM * (segment[0] + segment[1]) / 2,
    )
    result = coal.DistanceResult()
    return float(coal.distance(body, capsule, coal.DistanceRequest(), result)) / MM

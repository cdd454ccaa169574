"""Scenes for needles, and a judge of them that shares no code with the planner."""

from itertools import pairwise

import coal
import numpy as np
import pinocchio as pin

from plumbline.optim.pointing import Box, Capsule, Cylinder, HalfSpace, Mesh, Sphere

MM = 1e3


def turned(direction):
    """A rotation (3, 3) that takes z to a direction."""
    return pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(direction)).matrix()


def in_coal(shape, T):
    """A shape of ours as coal's object [mm], built from its fields, under a frame T (4, 4) [m]."""
    R, t = np.eye(3), np.zeros(3)
    if isinstance(shape, Box):
        low, high = np.array(shape.lower), np.array(shape.upper)
        made, t = coal.Box(MM * (high - low)), (low + high) / 2
    elif isinstance(shape, Sphere):
        made, t = coal.Sphere(MM * shape.radius), np.array(shape.centre)
    elif isinstance(shape, Capsule):
        a, b = np.array(shape.start), np.array(shape.end)
        made, t = coal.Capsule(MM * shape.radius, MM * np.linalg.norm(b - a)), (a + b) / 2
        R = turned(b - a)
    elif isinstance(shape, Cylinder):
        made, t = coal.Cylinder(MM * shape.radius, MM * shape.length), np.array(shape.centre)
        R = turned(shape.axis)
    elif isinstance(shape, HalfSpace):
        made, t, R = coal.Halfspace(np.array([0, 0, 1.0]), 0.0), np.array(shape.point), None
        R = turned(shape.normal)
    elif isinstance(shape, Mesh):
        made = coal.BVHModelOBBRSS()
        made.beginModel(len(shape.triangles), len(shape.vertices))
        made.addVertices(MM * shape.vertices)
        made.addTriangles(shape.triangles)
        made.endModel()
        made.computeLocalAABB()
    return coal.CollisionObject(made, T[:3, :3] @ R, MM * (T[:3, :3] @ t + T[:3, 3]))


def gap(one, two):
    """Coal's signed distance [m]."""
    return coal.distance(one, two, coal.DistanceRequest(), coal.DistanceResult()) / MM


def capsule(a, b, radius):
    """Coal's capsule [mm] about a segment [m]; None for a point."""
    length = np.linalg.norm(b - a)
    if length < 1e-6:
        return None
    return coal.CollisionObject(
        coal.Capsule(MM * radius, MM * length), turned(b - a), MM * (a + b) / 2
    )


def arm_at(aim, q):
    """Axes of the links [(name, a, b)], flange and direction of the needle, by Pinocchio."""
    chain = aim.chain
    data = chain.model.createData()
    pin.forwardKinematics(chain.model, data, chain.configuration(q))
    frames = [data.oMi[j + 1].homogeneous for j in range(chain.n)]
    frames.append(frames[-1] @ chain.T_last_tip)
    found = [("base", np.zeros(3), frames[0][:3, 3])]
    for joint, T, following in zip(chain.joints, frames, frames[1:], strict=False):
        axis = T[:3, :3] @ joint.axis
        corner = T[:3, 3] + axis * (axis @ (following[:3, 3] - T[:3, 3]))
        found += [(joint.name, T[:3, 3], corner), (joint.name, corner, following[:3, 3])]
    return found, frames[-1][:3, 3], frames[-1][:3, :3] @ np.array(aim.needle.axis)


def least_at(aim, q):
    """Least clearances {(first, second): m} of a posture that must not be below their limits."""
    arm, flange, along = arm_at(aim, q)
    tip, centre = flange + aim.needle.length * along, flange + aim.needle.reach * along
    movers = [(f"link {name}", capsule(a, b, aim.arm_radius)) for name, a, b in arm]
    needle = capsule(tip, flange, aim.needle.radius)
    path = capsule(centre, tip, aim.needle.radius)
    found = {}

    def note(first, second, one, two):
        if one is not None and two is not None:
            key = (first, second)
            found[key] = min(found.get(key, np.inf), gap(one, two))

    scene = aim.scene
    standing = [] if aim.body is None else [("body", aim.body, aim.T_robot_ct, True, False)]
    if scene is not None:
        standing += [(s.name, s.shape, aim.T_robot_ct, s.enter, False) for s in scene.anatomy]
        standing += [(s.name, s.shape, np.eye(4), s.enter, True) for s in scene.room]
    for name, shape, T, enter, room in standing:
        solid = in_coal(shape, T)
        for k, (first, mover) in enumerate(movers):
            if not (room and k < 2):  # the mounting
                note(first, name, mover, solid)
        note("needle", name, needle, solid)
        if not enter:
            note("needle path", name, path, solid)
    for first, mover in movers[: 2 * aim.chain.n - 3]:  # not the last two links
        note("needle", first, needle, mover)
        note("needle path", first, path, mover)
    return found


def shortfall(aim, q, per_step, least_clearance=2e-3):
    """How far the worst pair falls below its limit along a path (K, n) [m], and which it is."""
    limits = {}
    if aim.scene is not None:
        limits = {s.name: s.margin for s in (*aim.scene.anatomy, *aim.scene.room)}
    shares = np.linspace(0.0, 1.0, per_step + 1)[:, None]
    path = np.vstack([a + shares * (b - a) for a, b in pairwise(q)] or [q])
    worst, which = np.inf, None
    for posture in path:
        for pair, value in least_at(aim, posture).items():
            limit = limits.get(pair[1])
            spare = value - (least_clearance if limit is None else limit)
            if spare < worst:
                worst, which = spare, pair
    return worst, which


def ball(centre, radius, rings=12):
    """A sphere of triangles."""
    theta = np.linspace(0.0, np.pi, rings + 1)[1:-1, None]
    phi = np.linspace(0.0, 2 * np.pi, 2 * rings, endpoint=False)
    x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi
    middle = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    points = np.vstack([[0.0, 0.0, 1.0], middle, [0.0, 0.0, -1.0]])
    m, last = 2 * rings, len(points) - 1
    triangles = []
    for j in range(m):
        k = (j + 1) % m
        triangles += [(0, 1 + j, 1 + k), (last, last - m + k, last - m + j)]
        for i in range(rings - 2):
            a, b = 1 + i * m + j, 1 + i * m + k
            triangles += [(a, a + m, b), (b, a + m, b + m)]
    return Mesh(np.array(centre) + radius * points, triangles)

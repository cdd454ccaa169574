r"""Where to go first when the straight way is blocked (the patent's step of planes and waypoints).

The shaft R1 R2 sweeps to its goal G1 G2 within the plane of both, whose unit normal is

.. math:: n = \frac{(G_1 - R_1) \times (R_2 - R_1)}{|(G_1 - R_1) \times (R_2 - R_1)|}

The condition for "no interference" is garbled in the text that we have. What it can mean, and what
is implemented: an obstacle with ends O1, O2 and radius :math:`r_o` interferes if its axis comes
within :math:`D = r + r_o + d_s` of the plane,

.. math:: \min_{\mu \in [0, 1]} |n \cdot (O_1 + \mu (O_2 - O_1) - R_1)| < D

*and* does so inside of the region that the shaft will sweep: nearer than D to one of the shafts
between start and goal. The first alone would count obstacles far behind the trocar or beyond the
goal. The swept shafts lie in the plane, so the second implies the first, which serves to dismiss
most obstacles at once. Where start and goal lie on one line there is no plane, and the second alone
decides.

T is the point of the swept shaft that comes nearest, at the moment when it does; Z the obstacle's
point nearest T; w lies on the line from Z through T, clear of the obstacle,

.. math:: w = Z + (D + m)\, \frac{T - Z}{|T - Z|}, \qquad W = \beta\, w

with the direction n where T lies on the obstacle's axis. :math:`\beta = 0` says that nothing
interferes, and the goal is the reference. Else :math:`\beta < 1` weighs the way: the tip's
reference is :math:`(1 - \beta) G_1 + \beta\, w'` with w' the tip of the shaft that passes through
w, at every step anew. A weight cannot lead around a pocket, for which :func:`detour` looks along
more directions than n; the last resort, drawing back to the trocar, turning there and going in
along the goal's axis, needs no free plane at all.

References for the controller: the goals, or waypoints where the straight way is blocked.

The controller looks p steps ahead, so it slides around what it meets, and stops in pockets. The
guide looks at whole ways. At every step, for every tool,

1. nothing stands in the way (:math:`\beta = 0`): the goal;
2. an obstacle interferes: a free detour over one point, kept until it is done; the patent's
   waypoint while none is known;
3. no progress for a while, although tools may only block each other: a detour around everything as
   it stands, or back to the trocar, over, and in again, one tool at a time; where what is nearest
   is so outside, behind the trocar, deep in first, since drawing back puts more of the shaft there.

Where a tool cannot be at its goal, all others at theirs and the rest as it stands, no other way is
looked for: it stays where the controller comes to rest.

Drawing back is always possible where a tool came in straight, and near the trocars shafts are out
of each other's way, unless they cross outside.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.capsules import nearest
from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.bodies import Obstacle, TipInstrument, shafts
from plumbline.optim.capsule_mpc.statement import Statement
from plumbline.optim.capsule_mpc.sweeps import Sweeps, tip_speed
from plumbline.optim.core.problem import Array, Flags


@dataclass(frozen=True)
class Tool:
    """A shaft through a trocar, on its way to a goal."""

    trocar: Array  # the point it passes through (3,) [mm]
    tip: Array  # its tip (3,) [mm]
    goal: Array  # where the tip is to be (3,) [mm]
    length: float  # from the tip to the other end [mm]
    radius: float  # of the shaft [mm]

    def shafts(self, tips: Array) -> Array:
        """Both ends (N, 2, 3) [mm] with the tip at (N, 3)."""
        return shafts(tips, self.trocar, self.length)


@dataclass(frozen=True)
class Waypoint:
    """What the step gives."""

    beta: float  # 0 without interference, else below 1
    normal: Array  # of the plane (3,); zero if there is none
    blocking: int | None  # which obstacle comes nearest; None without interference
    T: Array  # point of the swept shaft that comes nearest (3,) [mm]
    Z: Array  # the obstacle's point nearest T (3,) [mm]
    w: Array  # clear of the obstacle (3,) [mm]
    reference: Array  # where the tip should go now (3,) [mm]; the goal without interference


def plane_normal(tool: Tool) -> Array:
    """Unit normal (3,) of the plane of the current and the goal axis; zero if they are one."""
    tail = tool.shafts(tool.tip[None])[0, 1]
    (a, b, c), (d, e, f) = (tool.goal - tool.tip).tolist(), (tail - tool.tip).tolist()
    across = np.array([b * f - c * e, c * d - a * f, a * e - b * d])  # np.cross takes 40 us
    size = float(np.sqrt(across @ across))
    return across / size if size > constants.EXACT * tool.length else np.zeros(3)


def plane_distances(normal: Array, point: Array, ends: Array) -> Array:
    """Distances (K,) of segments (K, 2, 3) from a plane [mm]; zero where they cross it."""
    sides = (ends - point) @ normal
    crosses = sides[:, 0] * sides[:, 1] <= 0.0
    return np.where(crosses, 0.0, np.abs(sides).min(axis=1))


def swept(tool: Tool, tips: Array, ends: Array, radii: Array) -> Array:
    """Distance less radii (N, K) [mm] of shafts with tips (N, 3) from obstacles (K, 2, 3)."""
    shafts = tool.shafts(tips)
    N, K = len(tips), len(ends)
    found = nearest(np.repeat(shafts, K, axis=0), np.tile(ends, (N, 1, 1)))
    return found.distance.reshape(N, K) - radii - tool.radius


def interferes(tool: Tool, ends: Array, radii: Array, safe: float) -> Flags:
    """Which obstacles (K,) interfere with the straight way; ends (K, 2, 3), radii (K,) [mm]."""
    if not len(ends):
        return np.zeros(0, dtype=bool)
    normal = plane_normal(tool)
    near = np.ones(len(ends), dtype=bool)
    if normal.any():
        near = plane_distances(normal, tool.tip, ends) < tool.radius + radii + safe
    if near.any():
        tips = np.linspace(tool.tip, tool.goal, constants.SAMPLES)
        near[near] = swept(tool, tips, ends[near], radii[near]).min(axis=0) < safe
    return near


def waypoint(tool: Tool, ends: Array, radii: Array, safe: float, beta: float = 0.9) -> Waypoint:
    """The patent's step for one tool among obstacles (K, 2, 3), (K,) and clearance d_s [mm]."""
    normal = plane_normal(tool)
    blocked = interferes(tool, ends, radii, safe)
    nothing = np.zeros(3)
    if not blocked.any():
        return Waypoint(0.0, normal, None, nothing, nothing, nothing, tool.goal)
    tips = np.linspace(tool.tip, tool.goal, constants.SAMPLES)
    gaps = np.where(blocked, swept(tool, tips, ends, radii), np.inf)
    which = int(np.argmin(gaps.min(axis=0)))
    # Of moments that are equally near, as where the sweep passes beside the axis, the middle one.
    near = np.nonzero(gaps[:, which] <= gaps[:, which].min() + constants.EXACT)[0]
    when = int(near[len(near) // 2])
    shaft = tool.shafts(tips[when : when + 1])
    found = nearest(shaft, ends[which : which + 1])
    T = shaft[0, 0] + found.share_one[0] * (shaft[0, 1] - shaft[0, 0])
    Z = T - found.difference[0]
    away = (
        normal if found.distance[0] < constants.EXACT else found.difference[0] / found.distance[0]
    )
    w = Z + (tool.radius + radii[which] + safe + constants.ROOM) * away
    depth = np.linalg.norm(tips[when] - tool.trocar)
    through = w - tool.trocar
    tip = tool.trocar + depth * through / max(float(np.linalg.norm(through)), constants.TOUCHING)
    reference = (1.0 - beta) * tool.goal + beta * tip
    return Waypoint(beta, normal, which, T, Z, w, reference)


def is_free(tool: Tool, tips: Array, ends: Array, radii: Array, safe: float) -> bool:
    """Whether the shaft keeps clear by ``safe`` [mm] along straight legs between tips (N, 3)."""
    if not len(ends):
        return True
    legs = [np.linspace(a, b, constants.SAMPLES) for a, b in pairwise(tips)]
    return bool((swept(tool, np.concatenate(legs), ends, radii) >= safe).all())


def detour(tool: Tool, ends: Array, radii: Array, safe: float) -> Array | None:
    """The shortest free way over one point beside the straight one, as tips (2, 3) [mm], if any.

    Tried in twelve directions across the way, the plane's normal first, at growing distances.
    """
    straight = tool.goal - tool.tip
    length = float(np.linalg.norm(straight))
    if length < constants.EXACT:
        return None
    first = plane_normal(tool)
    if not first.any():
        first = np.cross(straight, np.eye(3)[int(np.argmin(np.abs(straight)))])
        first = first / np.linalg.norm(first)
    second = np.cross(straight / length, first)
    angles = 2 * np.pi * np.arange(constants.DIRECTIONS) / constants.DIRECTIONS
    around = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    shares = np.array(constants.BESIDE)
    via = (
        (tool.tip + shares[:, None] * straight)[:, None, None]
        + np.array(constants.OFFSETS)[:, None, None] * around
    ).reshape(-1, 3)
    ways = np.linalg.norm(via - tool.tip, axis=1) + np.linalg.norm(via - tool.goal, axis=1)
    inside = (via - tool.trocar)[:, 2] * (tool.goal - tool.trocar)[2] > 0.0
    free = inside & (swept(tool, via, ends, radii) >= safe).all(axis=1)
    for k in np.argsort(ways):
        if free[k]:
            legs = np.stack([tool.tip, via[k], tool.goal])
            if is_free(tool, legs, ends, radii, safe):
                return legs[1:]
    return None


def drawn_back(tool: Tool, depth: float) -> Array:
    """Back to a depth [mm] along the shaft, over to the goal's axis there, in: tips (3, 3)."""
    now, then = tool.tip - tool.trocar, tool.goal - tool.trocar
    back = tool.trocar + depth * now / np.linalg.norm(now)
    over = tool.trocar + depth * then / np.linalg.norm(then)
    return np.stack([back, over, tool.goal])


class Guide:
    """References step by step; it remembers the detours that are under way."""

    def __init__(self, statement: Statement) -> None:
        """For a statement of instruments by their tips; other bodies are refused."""
        bodies = [body for body in statement.bodies if isinstance(body, TipInstrument)]
        if len(bodies) != len(statement.bodies):
            raise PlumblineError("guide: found other bodies, expected TipInstrument only")
        self.bodies = bodies
        self._narrow = constants.MM * statement.settings.safe
        self.safe = self._narrow + constants.EXTRA
        x, _, stage = statement.symbols
        self._limits = cs.Function("limits", [x, stage], [statement.limits])
        self._blank = statement.blank
        self._sweeps = Sweeps(statement.settings.dt, tip_speed(statement))
        self._ways: list[list[Array]] = [[] for _ in bodies]
        self._best = np.full(len(bodies), np.inf)
        self._since = np.zeros(len(bodies), dtype=int)
        self._stalls = np.zeros(len(bodies), dtype=int)

    def reference(self, tips: Array, goals: Array, obstacles: Sequence[Obstacle]) -> Array:
        """Where the tips (I, 3) should go now, on their way to the goals (I, 3) [m]."""
        if not (np.isfinite(tips).all() and np.isfinite(goals).all()):
            return goals
        seen = self._sweeps.swept(
            [o for o in (o.scaled(constants.MM) for o in obstacles) if o.usable]
        )
        ends = np.array([[o.a, o.b] for o in seen], dtype=float).reshape(-1, 2, 3)
        radii = np.array([o.radius for o in seen], dtype=float)
        tools = [
            Tool(body.constants, tip, goal, constants.MM * body.length, constants.MM * body.radius)
            for body, tip, goal in zip(
                self.bodies, constants.MM * tips, constants.MM * goals, strict=True
            )
        ]
        free = self._free(tools, ends, radii)
        ways = enumerate(tools)
        found = np.stack([self._next(i, t, ends, radii) if free[i] else t.goal for i, t in ways])
        self._watch(tools, found, free, ends, radii)
        return found / constants.MM

    def _next(self, i: int, tool: Tool, ends: Array, radii: Array) -> Array:
        way = self._ways[i]
        while way and np.linalg.norm(tool.tip - way[0]) < constants.THERE:
            way.pop(0)
            self._restart(i)
        if way:
            return way[0]
        if not interferes(tool, ends, radii, self._narrow).any():
            return tool.goal
        around = detour(tool, ends, radii, self.safe)
        if around is not None:
            self._ways[i] = list(around)
            self._restart(i)
            return around[0]
        return waypoint(tool, ends, radii, self.safe).reference

    def _restart(self, i: int) -> None:
        self._best[i], self._since[i] = np.inf, 0

    def _watch(
        self, tools: list[Tool], found: Array, free: Flags, ends: Array, radii: Array
    ) -> None:
        """Notice tools that come no closer, and send the first of them another way."""
        for i, tool in enumerate(tools):
            off = float(np.linalg.norm(tool.tip - found[i]))
            if off < self._best[i] - constants.PROGRESS:
                self._best[i], self._since[i] = off, 0
            elif free[i] and np.linalg.norm(tool.tip - tool.goal) > constants.THERE:
                self._since[i] += 1
        stuck = [i for i in range(len(tools)) if self._since[i] > constants.STALL]
        if stuck:
            # The one that has waited least often goes first, so that tools take turns.
            i = min(stuck, key=lambda k: (self._stalls[k], k))
            self._stalls[i] += 1
            self._ways[i] = self._another(i, tools, ends, radii)
            for k in range(len(tools)):
                self._restart(k)

    def _free(self, tools: list[Tool], ends: Array, radii: Array) -> Flags:
        """Which tools (I,) can be at their goals, all at theirs and obstacles as they stand."""
        shafts = np.concatenate([tool.shafts(tool.goal[None]) for tool in tools])
        count, others = len(tools), np.concatenate([shafts, ends])
        own = np.array([tool.radius for tool in tools])
        found = nearest(np.repeat(shafts, len(others), axis=0), np.tile(others, (count, 1, 1)))
        gaps = found.distance.reshape(count, -1) - own[:, None] - np.concatenate([own, radii])
        gaps[np.diag_indices(count)] = np.inf
        room = self._limits(shafts[:, 0].ravel(), self._blank).full().reshape(count, -1)
        return np.asarray((gaps >= self._narrow).all(axis=1) & (room >= 0.0).all(axis=1))

    def _another(self, i: int, tools: list[Tool], ends: Array, radii: Array) -> list[Array]:
        others = [tool for k, tool in enumerate(tools) if k != i]
        shafts = [tool.shafts(tool.tip[None]) for tool in others]
        all_ends = np.concatenate([ends, *shafts])
        all_radii = np.concatenate([radii, [tool.radius for tool in others]])
        around = detour(tools[i], all_ends, all_radii, self.safe) if self._stalls[i] == 1 else None
        if around is not None:
            return list(around)
        deep = _blocked_outside(tools[i], all_ends, all_radii) != (self._stalls[i] % 3 == 0)
        depth = constants.DEEP * tools[i].length if deep else constants.BACK
        return list(drawn_back(tools[i], depth))


def _blocked_outside(tool: Tool, ends: Array, radii: Array) -> bool:
    """Whether what is nearest to a shaft is so behind the trocar, where drawing back adds to it."""
    shafts = np.repeat(tool.shafts(tool.tip[None]), len(ends), axis=0)
    found = nearest(shafts, ends)
    k = int((found.distance - radii).argmin())
    return bool(found.share_one[k] * tool.length > np.linalg.norm(tool.tip - tool.trocar))

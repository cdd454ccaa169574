r"""References for the controller: the goals, or waypoints where the straight way is blocked.

The controller looks p steps ahead, so it slides around what it meets, and stops in pockets. The
guide looks at whole ways. At every step, for every tool,

1. nothing stands in the way (:math:`\beta = 0`): the goal;
2. an obstacle interferes: a free detour over one point, kept until it is done; the patent's
   waypoint while none is known;
3. no progress for a while, although tools may only block each other: a detour around everything as
   it stands, or back to the trocar, over, and in again, one tool at a time; where what is nearest
   is so outside, behind the trocar, deep in first, since drawing back puts more of the shaft there.

Drawing back is always possible where a tool came in straight, and near the trocars shafts are out
of each other's way, unless they cross outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.segments import nearest
from plumbline.optim.capsule_mpc.bodies import TipInstrument
from plumbline.optim.capsule_mpc.constants import MM
from plumbline.optim.capsule_mpc.scene import Obstacle
from plumbline.optim.capsule_mpc.statement import Statement
from plumbline.optim.capsule_mpc.sweeps import Sweeps, tip_speed
from plumbline.optim.capsule_mpc.waypoints import Tool, detour, drawn_back, interferes, waypoint
from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class Patience:
    """Options of the guide."""

    near: float = 0.003  # distance from a waypoint that counts as there [m]
    stall: int = 25  # steps in which a tool must come closer to its reference
    progress: float = 0.001  # by how much [m]
    extra: float = 0.0015  # clearance that ways keep beyond d_s [m]
    depth: float = 0.035  # of the tip behind the trocar when drawn back [m]
    # the same, as a share of the shaft's length, where shafts meet outside: what is in the way over
    # the trocars is passed with as little of the shaft there as inside
    deep: float = 0.5


class Guide:
    """References step by step; it remembers the detours that are under way."""

    def __init__(self, statement: Statement, patience: Patience = Patience()) -> None:
        """For a statement whose bodies are instruments by their tips, no others.

        Raises:
            PlumblineError: Other bodies.
        """
        bodies = [body for body in statement.bodies if isinstance(body, TipInstrument)]
        if len(bodies) != len(statement.bodies):
            raise PlumblineError("guide: found other bodies, expected TipInstrument only")
        self.bodies, self.patience = bodies, patience
        self._narrow = MM * statement.settings.safe
        self.safe = self._narrow + MM * patience.extra
        self._near = MM * patience.near
        self._sweeps = Sweeps(statement.settings.dt, tip_speed(statement))
        self._ways: list[list[Array]] = [[] for _ in bodies]
        self._best = np.full(len(bodies), np.inf)
        self._since = np.zeros(len(bodies), dtype=int)
        self._stalls = np.zeros(len(bodies), dtype=int)

    def reference(self, tips: Array, goals: Array, obstacles: Sequence[Obstacle]) -> Array:
        """Where the tips (I, 3) should go now, on their way to the goals (I, 3) [m]."""
        if not (np.isfinite(tips).all() and np.isfinite(goals).all()):
            return goals
        seen = self._sweeps.swept([o.scaled(MM) for o in obstacles if o.usable])
        ends = np.array([[o.a, o.b] for o in seen], dtype=float).reshape(-1, 2, 3)
        radii = np.array([o.radius for o in seen], dtype=float)
        tools = [
            Tool(body.constants, tip, goal, MM * body.length, MM * body.radius)
            for body, tip, goal in zip(self.bodies, MM * tips, MM * goals, strict=True)
        ]
        found = np.stack([self._next(i, tool, ends, radii) for i, tool in enumerate(tools)])
        self._watch(tools, found, ends, radii)
        return found / MM

    def _next(self, i: int, tool: Tool, ends: Array, radii: Array) -> Array:
        way = self._ways[i]
        while way and np.linalg.norm(tool.tip - way[0]) < self._near:
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

    def _watch(self, tools: list[Tool], found: Array, ends: Array, radii: Array) -> None:
        """Notice tools that come no closer, and send the first of them another way."""
        for i, tool in enumerate(tools):
            off = float(np.linalg.norm(tool.tip - found[i]))
            if off < self._best[i] - MM * self.patience.progress:
                self._best[i], self._since[i] = off, 0
            elif np.linalg.norm(tool.tip - tool.goal) > self._near:
                self._since[i] += 1
        stuck = [i for i in range(len(tools)) if self._since[i] > self.patience.stall]
        if stuck:
            # The one that has waited least often goes first, so that tools take turns.
            i = min(stuck, key=lambda k: (self._stalls[k], k))
            self._stalls[i] += 1
            self._ways[i] = self._another(i, tools, ends, radii)
            for k in range(len(tools)):
                self._restart(k)

    def _another(self, i: int, tools: list[Tool], ends: Array, radii: Array) -> list[Array]:
        others = [tool for k, tool in enumerate(tools) if k != i]
        shafts = [tool.shafts(tool.tip[None]) for tool in others]
        all_ends = np.concatenate([ends, *shafts])
        all_radii = np.concatenate([radii, [tool.radius for tool in others]])
        around = detour(tools[i], all_ends, all_radii, self.safe) if self._stalls[i] == 1 else None
        if around is not None:
            return list(around)
        deep = _blocked_outside(tools[i], all_ends, all_radii) != (self._stalls[i] % 3 == 0)
        depth = self.patience.deep * tools[i].length if deep else MM * self.patience.depth
        return list(drawn_back(tools[i], depth))


def _blocked_outside(tool: Tool, ends: Array, radii: Array) -> bool:
    """Whether what is nearest to a shaft is so behind the trocar, where drawing back adds to it."""
    shafts = np.repeat(tool.shafts(tool.tip[None]), len(ends), axis=0)
    found = nearest(shafts, ends)
    k = int((found.distance - radii).argmin())
    return bool(found.share_one[k] * tool.length > np.linalg.norm(tool.tip - tool.trocar))

r"""Which obstacles get the statement's slots where there are more of them: those that come nearest.

An obstacle's rank is the least distance of its capsule to any that moves, along what is foreseen of
it over the horizon and with all else as it stands,

.. math:: \min_{0 \le i \le p}\ \min_r\ d(x_0, O(i)) - r_r - r_O

and one that is left out is a danger if it can come within its margin before everything stands,

.. math:: \min_{0 \le i \le T}\ \min_r\ d(x_0, O(i)) - \rho_r(T) - D < 0

with :math:`\rho` the reach of what moves in a step and a stop after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from plumbline.kinematics.segments import nearest
from plumbline.optim.capsule_mpc.compiled import Compiled
from plumbline.optim.capsule_mpc.constants import NO_SEAT
from plumbline.optim.capsule_mpc.scene import Obstacle, foreseen
from plumbline.optim.capsule_mpc.statement import Statement
from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class Seated:
    """Obstacles with a slot, and what is known of the others."""

    kept: list[Obstacle]  # those with a slot
    dropped: int = 0  # how many have none
    gap: float = NO_SEAT  # least distance less its D of those [mm]
    danger: bool = False  # whether one of those can come within its margin before everything stands


class Seating:
    """Gives slots to obstacles."""

    def __init__(self, statement: Statement, steps: int) -> None:
        """For motions that end after so many steps."""
        self.statement, self.steps = statement, steps

    @cached_property
    def _links(self) -> Compiled:
        """``(x, within) -> ends (6 C,), radii (C,), reaches (C,)`` of all that moves."""
        own = self.statement
        x, _, _ = own.symbols
        within, ends, radii, reaches = cs.SX.sym("w", own.n), [], [], []
        for body, part in zip(own.bodies, own.parts, strict=True):
            c = cs.SX(cs.DM(body.constants))
            for link, reach in zip(
                body.capsules(x[part], c), body.reach(x[part], c, within[part]), strict=True
            ):
                ends.append(link.axis.ends)
                radii.append(cs.SX(link.radius))
                reaches.append(reach)
        outputs = [cs.densify(cs.vertcat(*values)) for values in (ends, radii, reaches)]
        return Compiled(cs.Function("links", [x, within], outputs), False)

    def seat(self, x0: Array, obstacles: Sequence[Obstacle]) -> Seated:
        """Those that come nearest to the capsules at x0 (n,), as many as there are slots for."""
        own = self.statement
        balls = sum(o.a == o.b for o in obstacles)
        if len(obstacles) - min(balls, own.balls) <= own.slots:
            return Seated(list(obstacles))
        gaps, reach = self._gaps(x0, obstacles)
        order = np.argsort(gaps[: own.settings.p + 1].min(axis=(0, 2)), kind="stable")
        taken = self._taken(obstacles, [int(k) for k in order])
        rest = [k for k in range(len(obstacles)) if k not in taken]
        soon = gaps[: self.steps + 1, rest] - reach
        here = float(gaps[0, rest].min())
        kept = [obstacles[k] for k in sorted(taken)]
        return Seated(kept, len(rest), here, bool(soon.min() < 0.0))

    def _gaps(self, x0: Array, obstacles: Sequence[Obstacle]) -> tuple[Array, Array]:
        """Distances less D (T, K, C) at this and later steps, and reaches (C,) [mm]."""
        own = self.statement
        s = own.settings
        ends, radii, reach = (v.copy() for v in self._links(x0, self.steps * s.dt * own.speed))
        links = ends.reshape(-1, 2, 3)
        table = foreseen(obstacles, len(obstacles), 1 + max(s.p, self.steps), s.dt, 0)
        shape = (*table.shape[:2], len(links))
        axes = np.broadcast_to(table[:, :, None, :6], (*shape, 6)).reshape(-1, 2, 3)
        shafts = np.broadcast_to(links, (*shape, 2, 3)).reshape(-1, 2, 3)
        found = nearest(shafts, axes).distance.reshape(shape)
        # Between two steps an obstacle may come nearer by half of its way at most.
        half = np.linalg.norm(table[:, :, 7:], axis=2) / 2
        half[0] = 0.0
        margin = s.apart[1]
        return found - radii - (table[:, :, 6] + half)[:, :, None] - margin, reach

    def _taken(self, obstacles: Sequence[Obstacle], order: list[int]) -> set[int]:
        """Numbers of those with a slot: a sphere takes a capsule's where spheres have none left."""
        slots, balls, taken = self.statement.slots, self.statement.balls, set()
        for k in order:
            ball = obstacles[k].a == obstacles[k].b
            if ball and balls:
                balls -= 1
            elif slots:
                slots -= 1
            else:
                continue
            taken.add(k)
        return taken

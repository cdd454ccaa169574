r"""Obstacles as numbers: capsules and spheres that stand still or move.

An obstacle is known by both ends of its axis (a sphere's ends are one point), its radius and its
velocity; what the controller foresees of it is a straight line,

.. math:: O(i) = O + i\, dt\, v_O, \qquad i = 1 \ldots p

unless a path is given for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.optim.capsule_mpc.bodies import Point
from plumbline.optim.capsule_mpc.constants import FAR, STILL
from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class Obstacle:
    """A capsule, or a sphere if both ends are one point.

    In m as a loop gives it; in mm in all that the controller does with it (:meth:`scaled`).
    """

    a: Point  # one end of its axis [m]
    b: Point  # the other end [m]
    radius: float  # its radius [m]
    velocity: Point = STILL  # how it moves [m/s]

    @classmethod
    def sphere(cls, centre: Point, radius: float, velocity: Point = STILL) -> Obstacle:
        """A sphere."""
        return cls(centre, centre, radius, velocity)

    def scaled(self, by: float) -> Obstacle:
        """The same in another unit of length."""
        a, b, v = ((by * p[0], by * p[1], by * p[2]) for p in (self.a, self.b, self.velocity))
        return Obstacle(a, b, by * self.radius, v)

    @property
    def usable(self) -> bool:
        """Whether every number of it is finite, and its radius not negative."""
        numbers = [*self.a, *self.b, *self.velocity, self.radius]
        return bool(np.isfinite(numbers).all()) and self.radius >= 0.0


def sorted_obstacles(
    obstacles: Sequence[Obstacle], balls: int
) -> tuple[list[Obstacle], list[Obstacle]]:
    """Capsules, and at most so many spheres; spheres beyond that go with the capsules."""
    spheres = [obstacle for obstacle in obstacles if obstacle.a == obstacle.b]
    rest = [obstacle for obstacle in obstacles if obstacle.a != obstacle.b]
    return rest + spheres[balls:], spheres[:balls]


def foreseen(obstacles: Sequence[Obstacle], slots: int, p: int, dt: float, first: int = 1) -> Array:
    """Ends, radius, and motion in a step (p, slots, 10) [mm] from ``first`` steps on."""
    out = np.empty((p, slots, 10))
    count = min(len(obstacles), slots)
    out[:, count:] = [FAR] * 6 + [0.0] * 4
    if count:
        numbers = np.array([(*o.a, *o.b, o.radius, *o.velocity) for o in obstacles[:count]])
        step = dt * numbers[:, 7:]
        ahead = np.arange(first, p + first)[:, None, None]
        moved = ahead * step
        out[:, :count, :3] = numbers[:, :3] + moved
        out[:, :count, 3:6] = numbers[:, 3:6] + moved
        out[:, :count, 6], out[:, :count, 7:] = numbers[:, 6], step
    return out

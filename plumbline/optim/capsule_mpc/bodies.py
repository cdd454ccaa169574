r"""What moves, as x+ = x + B u: an instrument by its tip, or an instrument by both ends.

By its tip x, the trocar c is built in, and the other end follows from the instrument's length:

.. math:: e(x) = x - L\, (x - c) / |x - c|

three states for an instrument. By both ends, six states, length and trocar are equations that the
solver must hold:

.. math:: |a - b| = L, \qquad (I - v v^T)(c - a) = 0, \quad v = (a - b) / L

While a state goes from x - d to x on a straight line, the ends of a capsule stay beside the chords
between their places by no more than a sagitta. By its tip, the shaft's direction v turns with
:math:`|\ddot v| \le 2 |\dot x|^2 / (\sqrt 3\, r^2)`, r the depth (the part of the rate along the
shaft that makes it largest is a third of its square), so that

.. math:: |e(t) - \text{chord}(t)| \le \tfrac18\, L \max |\ddot v|\, dt^2
          \le L\, |d|^2 / (4 \sqrt 3\, r^2)

The outer end moves (L - r) / r times as far as the tip across the shaft. It is not to move faster
than w, whence a bound V on the tip's rate where it is shallow: the depth falls to r - V dt at
worst, and :math:`V\, (L - r + V\, dt) = w\, (r - V\, dt)`.

The first costs about half as much. What a body is made from is in SI units, what its functions take
and give is in mm: the distance tests of a solver have absolute thresholds, which are meant for
numbers of that size.

Obstacles as numbers: capsules and spheres that stand still or move.

An obstacle is known by both ends of its axis (a sphere's ends are one point), its radius and its
velocity; what the controller foresees of it is a straight line,

.. math:: O(i) = O + i\, dt\, v_O, \qquad i = 1 \ldots p

unless a path is given for it.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Protocol

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import Range, expect_fields
from plumbline.errors import PlumblineError
from plumbline.kinematics.capsules import Segment, length_of
from plumbline.optim.capsule_mpc import settings
from plumbline.optim.capsule_mpc.constants import (
    A_MAX,
    CONE,
    FAR,
    J_MAX,
    MM,
    NARROWEST,
    SHALLOW,
    STILL,
    TOUCHING,
    V_OUTER,
)
from plumbline.optim.capsule_mpc.settings import Depth, Length, Point, Thickness, near
from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class SymbolicCapsule:
    """One capsule of a body in symbols: its axis and its radius [mm]."""

    axis: Segment
    radius: float | cs.SX


class Body(Protocol):
    """Something that the controller moves, stated as functions of its state x (n,).

    They take its constants c (k,) as symbols too: bodies that differ in nothing else share one
    compiled function.
    """

    @property
    def size(self) -> int:
        """Number of states n."""

    @property
    def unit(self) -> Array:
        """What one unit of each state is (n,) [m, or rad]."""

    @property
    def groups(self) -> tuple[int, ...]:
        """Sizes of groups of states, in their order, whose rates are bounded by Euclidean norm."""

    @property
    def speed(self) -> Array:
        """Largest rate (n,) of the group of each state [mm/s, or units/s of a joint]."""

    @property
    def acceleration(self) -> Array:
        """Largest change of that rate (n,) [mm/s^2, or units/s^2]."""

    @property
    def jerk(self) -> Array:
        """Largest change of that acceleration (n,) [mm/s^3, or units/s^3]."""

    @property
    def constants(self) -> Array:
        """Numbers (k,) that its functions take beside the state [mm]."""

    @property
    def shape(self) -> Hashable:
        """The same body with its constants put to zero."""

    @property
    def own_pairs(self) -> tuple[tuple[int, int], ...]:
        """Which of its capsules, by their numbers, must not touch each other either."""

    def capsules(self, x: cs.SX, c: cs.SX) -> tuple[SymbolicCapsule, ...]:
        """All that must touch nothing [mm]."""

    def tracked(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """What is compared with the goal (g,) [mm]."""

    def held(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """What must stay zero (h,) [mm]; nothing by default."""
        return cs.SX(0, 1)

    def limits(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """What must stay positive (l,) [mm, or rad of a joint]; nothing by default."""
        return cs.SX(0, 1)

    def pace(self, x: cs.SX, c: cs.SX, dt: float) -> cs.SX:
        """Bound (n,) on the rate of each state's group in a step of dt [s] that begins at x."""
        return cs.SX(cs.DM(self.speed))

    def sagitta(self, x: cs.SX, c: cs.SX, d: cs.SX) -> tuple[cs.SX, ...]:
        """How far the ends of each capsule leave their chords on the way from x - d to x [mm]."""

    def through(self, c: cs.SX) -> tuple[cs.SX | None, ...]:
        """The point (3,) that the axis of each capsule always passes through [mm], if any."""

    def lever(self, x: cs.SX, c: cs.SX, share: cs.SX) -> cs.SX:
        """How far the point at a share of an axis moves across it, of a state's error."""
        return cs.SX(1.0)

    def reach(self, x: cs.SX, c: cs.SX, within: cs.SX) -> tuple[cs.SX, ...]:
        """Bound on how far any point of each capsule moves [mm], groups within bounds (n,)."""


class _Shaft(Body, Protocol):
    """What instruments share: bounds that hold along all coordinates, and no pairs of their own."""

    v_max: settings.Speed
    a_max: settings.Acceleration
    j_max: settings.Jerk

    def __post_init__(self) -> None:
        expect_fields(self)

    @property
    def unit(self) -> Array:
        return np.full(self.size, 1 / MM)

    @property
    def speed(self) -> Array:
        return np.full(self.size, MM * self.v_max)

    @property
    def acceleration(self) -> Array:
        return np.full(self.size, MM * self.a_max)

    @property
    def jerk(self) -> Array:
        return np.full(self.size, MM * self.j_max)

    @property
    def own_pairs(self) -> tuple[tuple[int, int], ...]:
        return ()


@dataclass(frozen=True)
class TipInstrument(_Shaft):
    """An instrument through a trocar, its state the place of its tip (3,)."""

    trocar: Point  # the point that the shaft passes through [m]
    length: Length = 0.25  # from the tip to the other end of the shaft [m]
    radius: Thickness = 0.0025  # of the shaft [m]
    v_max: settings.Speed = 0.06  # largest speed of the tip [m/s]
    # least and most depth of the tip behind the trocar [m]; the direction of the shaft is
    # undefined at the trocar itself
    depths: tuple[Depth, Depth] = (0.015, 0.23)
    a_max: settings.Acceleration = A_MAX  # largest acceleration of the tip [m/s^2]
    j_max: settings.Jerk = J_MAX  # largest jerk of the tip [m/s^3]
    v_outer: settings.Speed = V_OUTER  # largest speed of the other end [m/s]
    inward: Point = (0.0, 0.0, -1.0)  # direction into the body through the trocar's plane
    # largest angle between the shaft and that direction [degrees], below 90: the tip stays inside
    # of the body
    cone: Annotated[float, Range(NARROWEST, 90.0, ")", "state it in degrees")] = CONE

    size: int = field(default=3, init=False)
    groups: tuple[int, ...] = field(default=(3,), init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.depths[0] >= self.depths[1]:
            raise PlumblineError(f"depths: found {self.depths}, expected least < most; swap them")
        if not np.any(self.inward):
            raise PlumblineError("inward: found no direction, expected one into the body; mend it")

    @property
    def constants(self) -> Array:
        """The trocar."""
        return MM * np.array(self.trocar)

    @property
    def shape(self) -> Hashable:
        """The same with its trocar at zero."""
        return replace(self, trocar=(0.0, 0.0, 0.0))

    def capsules(self, x: cs.SX, c: cs.SX) -> tuple[SymbolicCapsule, ...]:
        """The shaft, tip first."""
        inside = x - c
        back = x - MM * self.length * inside / length_of(inside)
        return (SymbolicCapsule(Segment(x, back), MM * self.radius),)

    def tracked(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """The tip."""
        return x

    def limits(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """Room to the least and the most depth, and to the cone (3,) [mm]."""
        depth = length_of(x - c)
        inward = np.array(self.inward) / np.linalg.norm(self.inward)
        below = cs.dot(cs.DM(inward), x - c) - np.cos(np.radians(self.cone)) * depth
        return cs.vertcat(depth - MM * self.depths[0], MM * self.depths[1] - depth, below)

    def pace(self, x: cs.SX, c: cs.SX, dt: float) -> cs.SX:
        """What keeps the tip within its own speed and the other end within its."""
        depth = length_of(x - c)
        fastest = MM * self.v_outer
        half = (MM * self.length - depth + fastest * dt) / 2
        outer = (cs.sqrt(half**2 + dt * fastest * depth) - half) / dt
        return cs.repmat(cs.fmin(MM * self.v_max, outer), 3, 1)

    def sagitta(self, x: cs.SX, c: cs.SX, d: cs.SX) -> tuple[cs.SX, ...]:
        """The shaft's, its depth as little as it can be on the way."""
        moved = length_of(d)
        depth = cs.fmax(length_of(x - c) - moved, SHALLOW)
        return (MM * self.length * moved**2 / (4 * np.sqrt(3.0) * depth**2),)

    def through(self, c: cs.SX) -> tuple[cs.SX | None, ...]:
        """The trocar, if the shaft is long enough to reach back to it from any depth."""
        return (c if self.length >= self.depths[1] else None,)

    def lever(self, x: cs.SX, c: cs.SX, share: cs.SX) -> cs.SX:
        """The shaft turns about the trocar, so its points move in proportion to their distance."""
        depth = cs.fmax(length_of(x - c), SHALLOW)
        return cs.fmax(1.0, cs.fabs(share * MM * self.length - depth) / depth)

    def reach(self, x: cs.SX, c: cs.SX, within: cs.SX) -> tuple[cs.SX, ...]:
        r"""The tip moves by at most m, the other end by at most :math:`m + |L - r|\,\delta`.

        The direction turns by an angle whose sine is at most m / r, so its change
        :math:`\delta \le \sqrt 2\, m / r` while m < r, and never more than 2.
        """
        depth = length_of(x - c)
        most = within[0]
        turn = cs.if_else(most < depth, np.sqrt(2.0) * most / depth, 2.0)
        return (most + cs.fabs(MM * self.length - depth) * turn,)


@dataclass(frozen=True)
class EndsInstrument(_Shaft):
    """An instrument by both ends of its shaft: tip, then the other end (6,)."""

    length: Length = 0.25  # of the shaft [m]
    radius: Thickness = 0.0025  # of the shaft [m]
    v_max: settings.Speed = 0.06  # largest speed of either end [m/s]
    # the point that the shaft passes through [m]; None for a free capsule
    trocar: Point | None = None
    a_max: settings.Acceleration = A_MAX  # largest acceleration of either end [m/s^2]
    j_max: settings.Jerk = J_MAX  # largest jerk of either end [m/s^3]

    size: int = field(default=6, init=False)
    groups: tuple[int, ...] = field(default=(3, 3), init=False)

    @property
    def constants(self) -> Array:
        """The trocar, if there is one."""
        return MM * np.array(self.trocar or (), dtype=float)

    @property
    def shape(self) -> Hashable:
        """The same with its trocar, if it has one, at zero."""
        return replace(self, trocar=self.trocar and (0.0, 0.0, 0.0))

    def capsules(self, x: cs.SX, c: cs.SX) -> tuple[SymbolicCapsule, ...]:
        """The shaft, tip first."""
        return (SymbolicCapsule(Segment.of(x), MM * self.radius),)

    def tracked(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """Both ends of a free capsule; the tip alone where a trocar says where the rest is."""
        return x if self.trocar is None else x[:3]

    def held(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """Length, and the trocar's distance from the axis in two directions across it [mm]."""
        length = MM * self.length
        axis = (x[:3] - x[3:]) / length
        rigid = (cs.sumsqr(x[:3] - x[3:]) - length**2) / (2 * length)
        if self.trocar is None:
            return rigid
        offset = c - x[:3]
        across = offset - cs.dot(offset, axis) * axis
        return cs.vertcat(rigid, *(cs.dot(side, across) for side in sides(axis)))

    def sagitta(self, x: cs.SX, c: cs.SX, d: cs.SX) -> tuple[cs.SX, ...]:
        """None: the ends are the state."""
        return (cs.SX(0.0),)

    def through(self, c: cs.SX) -> tuple[cs.SX | None, ...]:
        """The trocar, if there is one."""
        return (None if self.trocar is None else c,)

    def reach(self, x: cs.SX, c: cs.SX, within: cs.SX) -> tuple[cs.SX, ...]:
        """A point between two ends moves no farther than the farther of them."""
        return (cs.fmax(within[0], within[3]),)

    def state(self, tip: Point | Array) -> Array:
        """Both ends (6,) [m] of a shaft with its tip at a point; refused without a trocar."""
        if self.trocar is None:
            raise PlumblineError("state of a free capsule: a tip alone found, both ends expected")
        inside = np.asarray(tip, dtype=float) - self.trocar
        return np.concatenate([tip, tip - self.length * inside / np.linalg.norm(inside)])


def sides(axis: cs.SX) -> tuple[cs.SX, cs.SX]:
    """Two unit vectors across a unit vector (3,) (Duff et al. 2017, JCGT 6(1), listing 3)."""
    x, y, z = axis[0], axis[1], axis[2]
    sign = cs.if_else(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    return cs.vertcat(1 + sign * x * x * a, sign * b, -sign * x), cs.vertcat(
        b, sign + y * y * a, -y
    )


def shafts(tips: Array, trocars: Array, lengths: ArrayLike) -> Array:
    """Both ends (..., 2, 3) of shafts through trocars with their tips at points (..., 3)."""
    inside = tips - trocars
    depth = np.sqrt(np.vecdot(inside, inside))[..., None]
    back = tips - np.asarray(lengths)[..., None] * inside / np.maximum(depth, TOUCHING)
    return np.stack([tips, back], axis=-2)


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
        """Whether its numbers, in mm, are finite, its place is near, its radius not negative."""
        known = bool(np.isfinite(self.velocity).all()) and self.radius >= 0.0
        return known and near(np.array([*self.a, *self.b, self.radius]) / MM)


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

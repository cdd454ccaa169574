r"""What moves, as x+ = x + B u: an instrument by its tip, or an instrument by both ends.

By its tip x, the trocar c is built in, and the other end follows from the instrument's length:

.. math:: e(x) = x - L\, (x - c) / |x - c|

three states for an instrument. By both ends, six states, length and trocar are equations that the
solver must hold:

.. math:: |a - b| = L, \qquad (I - v v^T)(c - a) = 0, \quad v = (a - b) / L

The first costs about half as much. Lengths are in mm throughout this package and never in m: the
distance tests of a solver have absolute thresholds, which are meant for numbers of that size.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from typing import Protocol

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from kinematics.capsules import Segment

Array = NDArray[np.float64]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Capsule:
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
    def speed(self) -> Array:
        """Largest rate (n,) of each state [mm/s, or rad/s of a joint]."""

    @property
    def constants(self) -> Array:
        """Numbers (k,) that its functions take beside the state [mm]."""

    @property
    def shape(self) -> Hashable:
        """The same body with its constants put to zero."""

    @property
    def own_pairs(self) -> tuple[tuple[int, int], ...]:
        """Which of its capsules, by their numbers, must not touch each other either."""

    def capsules(self, x: cs.SX, c: cs.SX) -> tuple[Capsule, ...]:
        """All that must touch nothing [mm]."""

    def tracked(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """What is compared with the goal (g,) [mm]."""

    def held(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """What must stay zero (h,) [mm]."""

    def limits(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """What must stay positive (l,) [mm, or rad of a joint]."""

    def reach(self, x: cs.SX, c: cs.SX, within: cs.SX) -> tuple[cs.SX, ...]:
        """Bound on how far any point of each capsule moves [mm].

        Args:
            x: State from where it moves.
            c: Its constants.
            within: Bounds (n,) on the change of each state.
        """


@dataclass(frozen=True)
class TipInstrument:
    """An instrument through a trocar, its state the place of its tip (3,) [mm].

    Attributes:
        trocar: The point that the shaft passes through [mm].
        length: From the tip to the other end of the shaft [mm].
        radius: Of the shaft [mm].
        v_max: Largest speed of the tip along each axis [mm/s].
        depths: Least and most depth of the tip behind the trocar [mm]; the direction of the shaft
            is undefined at the trocar itself.
    """

    trocar: Point
    length: float = 250.0
    radius: float = 2.5
    v_max: float = 60.0
    depths: tuple[float, float] = (15.0, 230.0)

    size: int = field(default=3, init=False)
    own_pairs: tuple[tuple[int, int], ...] = field(default=(), init=False)

    @property
    def constants(self) -> Array:
        """The trocar."""
        return np.array(self.trocar, dtype=float)

    @property
    def shape(self) -> Hashable:
        """The same with its trocar at zero."""
        return replace(self, trocar=(0.0, 0.0, 0.0))

    @property
    def speed(self) -> Array:
        """Largest rate (3,) of each coordinate [mm/s]."""
        return np.full(3, self.v_max)

    def capsules(self, x: cs.SX, c: cs.SX) -> tuple[Capsule, ...]:
        """The shaft, tip first."""
        inside = x - c
        back = x - self.length * inside / cs.sqrt(cs.sumsqr(inside) + 1e-12)
        return (Capsule(Segment(x, back), self.radius),)

    def tracked(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """The tip."""
        return x

    def held(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """Nothing: the trocar is built in."""
        return cs.SX(0, 1)

    def limits(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """Room to the least and to the most depth (2,) [mm]."""
        depth = cs.sqrt(cs.sumsqr(x - c) + 1e-12)
        return cs.vertcat(depth - self.depths[0], self.depths[1] - depth)

    def reach(self, x: cs.SX, c: cs.SX, within: cs.SX) -> tuple[cs.SX, ...]:
        r"""The tip moves by at most m, the other end by at most :math:`m + |L - r|\,\delta`.

        The direction turns by an angle whose sine is at most m / r, so its change
        :math:`\delta \le \sqrt 2\, m / r` while m < r, and never more than 2.
        """
        depth = cs.sqrt(cs.sumsqr(x - c) + 1e-12)
        most = cs.norm_2(within)
        turn = cs.if_else(most < depth, np.sqrt(2.0) * most / depth, 2.0)
        return (most + cs.fabs(self.length - depth) * turn,)


@dataclass(frozen=True)
class EndsInstrument:
    """An instrument by both ends of its shaft: tip, then the other end (6,) [mm].

    Attributes:
        length: Of the shaft [mm].
        radius: Of the shaft [mm].
        v_max: Largest speed of either end along each axis [mm/s].
        trocar: The point that the shaft passes through [mm]; None for a free capsule.
    """

    length: float = 250.0
    radius: float = 2.5
    v_max: float = 60.0
    trocar: Point | None = None

    size: int = field(default=6, init=False)
    own_pairs: tuple[tuple[int, int], ...] = field(default=(), init=False)

    @property
    def constants(self) -> Array:
        """The trocar, if there is one."""
        return np.array(self.trocar or (), dtype=float)

    @property
    def shape(self) -> Hashable:
        """The same with its trocar, if it has one, at zero."""
        return replace(self, trocar=self.trocar and (0.0, 0.0, 0.0))

    @property
    def speed(self) -> Array:
        """Largest rate (6,) of each coordinate [mm/s]."""
        return np.full(6, self.v_max)

    def capsules(self, x: cs.SX, c: cs.SX) -> tuple[Capsule, ...]:
        """The shaft, tip first."""
        return (Capsule(Segment.of(x), self.radius),)

    def tracked(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """Both ends of a free capsule; the tip alone where a trocar says where the rest is."""
        return x if self.trocar is None else x[:3]

    def held(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """Length, and the trocar's distance from the axis in two directions across it [mm]."""
        axis = (x[:3] - x[3:]) / self.length
        rigid = (cs.sumsqr(x[:3] - x[3:]) - self.length**2) / (2 * self.length)
        if self.trocar is None:
            return rigid
        offset = c - x[:3]
        across = offset - cs.dot(offset, axis) * axis
        return cs.vertcat(rigid, *(cs.dot(side, across) for side in sides(axis)))

    def limits(self, x: cs.SX, c: cs.SX) -> cs.SX:
        """None."""
        return cs.SX(0, 1)

    def reach(self, x: cs.SX, c: cs.SX, within: cs.SX) -> tuple[cs.SX, ...]:
        """A point between two ends moves no farther than the farther of them."""
        return (cs.fmax(cs.norm_2(within[:3]), cs.norm_2(within[3:])),)

    def state(self, tip: Point | Array) -> Array:
        """Both ends (6,) [mm] of a shaft through the trocar with its tip at a point.

        Raises:
            ValueError: The instrument has no trocar, so its direction is not given by its tip.
        """
        if self.trocar is None:
            raise ValueError("state of a free capsule: a tip alone found, both ends expected")
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

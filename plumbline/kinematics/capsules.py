r"""Distances of capsules in symbols: one scalar a pair, or a plane between the two.

A capsule is all that lies within a radius of a segment, so the clearance of two is

.. math:: d_{ij} = \min_{s, t \in [0, 1]} |p_i + s\, u_i - p_j - t\, u_j| - (r_i + r_j)

The minimum is taken without a branch, by clamping three quotients in turn (Ericson 2005, Real-Time
Collision Detection, sec. 5.1.9, its cases folded into one): an ``if_else`` would evaluate both of
its branches, and the derivative of the one not taken may be NaN. Where shafts are parallel the
nearest points jump, and the scalar's gradient with them. The other form has no such jump: segments
are D apart if and only if some unit normal n has (separating hyperplane theorem; Boyd and
Vandenberghe 2004, sec. 2.5.1)

.. math:: n \cdot (a - b) \ge D \quad\text{for all four pairs of end points } a, b.

Lengths are in any one unit, but the guards below are meant for mm: not for capsules in metres.

Capsules along the bones of a robot, from each joint to the next; lengths are in m.

Many pairs of segments at once, in NumPy: the arithmetic of :mod:`.capsules`.

.. math:: d = |p(s) - q(t)|, \qquad n = (p(s) - q(t)) / d

For callers with many pairs, another number each time; the tests hold symbols, arrays and coal
together. Unless the two segments touch, the normal n separates them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.constants import ALONG, SHORTEST, TINY
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.frames import Transform, constant


@dataclass(frozen=True)
class Segment:
    """The axis of a capsule in symbols."""

    a: cs.SX  #: one end (3,)
    b: cs.SX  #: the other end (3,)

    @classmethod
    def of(cls, ends: cs.SX) -> Self:
        """From both ends in one vector (6,)."""
        return cls(ends[:3], ends[3:])

    @property
    def ends(self) -> cs.SX:
        """Both ends (6,)."""
        return cs.vertcat(self.a, self.b)

    def point(self, share: cs.SX) -> cs.SX:
        """The point (3,) at a share of the way from a to b."""
        return self.a + share * (self.b - self.a)


def length_of(v: cs.SX) -> cs.SX:
    """Length of a vector (3,); its slope is finite where that is nothing."""
    return cs.sqrt(cs.sumsqr(v) + TINY)


def _clamp(value: cs.SX) -> cs.SX:
    return cs.fmin(cs.fmax(value, 0.0), 1.0)


def nearest_shares(one: Segment, two: Segment) -> tuple[cs.SX, cs.SX]:
    """Shares s and t, in [0, 1], of the nearest points of two segments; finite everywhere."""
    u, v, r = one.b - one.a, two.b - two.a, one.a - two.a
    a, e = cs.sumsqr(u) + TINY, cs.sumsqr(v) + TINY
    b, c, f = cs.dot(u, v), cs.dot(u, r), cs.dot(v, r)
    determinant = cs.fmax(a * e - b * b, ALONG * a * e + TINY)
    s = _clamp((b * f - c * e) / determinant)
    t = _clamp((b * s + f) / e)
    return _clamp((b * t - c) / a), t


def overlap_shares(one: Segment, two: Segment) -> tuple[cs.SX, cs.SX]:
    """Shares of the first segment, in [0, 1], beside which the ends of the second lie."""
    u = one.b - one.a
    length2 = cs.sumsqr(u) + TINY
    first, second = (cs.dot(u, end - one.a) / length2 for end in (two.a, two.b))
    return _clamp(first), _clamp(second)


def share_beside(point: cs.SX, segment: Segment) -> cs.SX:
    """Share of a segment, in [0, 1], that is nearest to a point (3,)."""
    v = segment.b - segment.a
    return _clamp(cs.dot(v, point - segment.a) / (cs.sumsqr(v) + TINY))


def squared_distance(one: Segment, two: Segment) -> cs.SX:
    """Squared distance [length^2] of two segments."""
    s, t = nearest_shares(one, two)
    return cs.sumsqr(one.point(s) - two.point(t))


def scalar_gap(one: Segment, two: Segment, least: cs.SX | float) -> cs.SX:
    """The patent's one scalar a pair, to be >= 0: :math:`(d^2 - D^2) / (2 D)`, D = ``least``.

    It has the value and the slope of d - D on the boundary, and no square root, whose derivative
    at contact is NaN.
    """
    return (squared_distance(one, two) - least * least) / (2 * least)


def plane_gaps(normal: cs.SX, one: Segment, two: Segment) -> cs.SX:
    """Distances (4,) along a normal (3,) from the ends of ``two`` to the ends of ``one``.

    All four at least D, with a normal no longer than 1, prove the segments to be D apart.
    """
    return cs.vertcat(*(cs.dot(normal, p - q) for p in (one.a, one.b) for q in (two.a, two.b)))


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
    """Capsules of a radius [m] from every joint to the next, and from the last to the tip.

    ``skip`` are joints (from 0; -1 for the base) whose link gets none.
    """
    nexts = [joint.T_parent_joint[:3, 3] for joint in chain.joints] + [chain.T_last_tip[:3, 3]]
    names = ["base", *chain.joint_names]
    found = []
    for k, end in enumerate(nexts):
        if k - 1 not in skip and np.linalg.norm(end) > SHORTEST:
            found.append(LinkCapsule(k - 1, np.stack([np.zeros(3), end]), radius, names[k]))
    return tuple(found)


@dataclass(frozen=True)
class Nearest:
    """Nearest points of N pairs of segments."""

    distance: Array  # distances (N,) of the axes, never negative
    difference: Array  # from the point on the second to the point on the first (N, 3)
    share_one: Array  # where on the first (N,), 0 at its first end and 1 at its second
    share_two: Array  # where on the second (N,)


def nearest(one: ArrayLike, two: ArrayLike) -> Nearest:
    """Nearest points of pairs of segments.

    Args:
        one: Ends (N, 2, 3).
        two: Ends (N, 2, 3).
    """
    first, second = np.asarray(one, dtype=float), np.asarray(two, dtype=float)
    p, q = first[:, 0], second[:, 0]
    u, v, r = first[:, 1] - p, second[:, 1] - q, p - q
    a, e = np.vecdot(u, u) + TINY, np.vecdot(v, v) + TINY
    b, c, f = np.vecdot(u, v), np.vecdot(u, r), np.vecdot(v, r)
    ae = a * e
    determinant = np.maximum(ae - b * b, ALONG * ae + TINY)
    s = _clamped((b * f - c * e) / determinant)
    t = _clamped((b * s + f) / e)
    s = _clamped((b * t - c) / a)
    difference = r + s[:, None] * u - t[:, None] * v
    return Nearest(np.sqrt(np.vecdot(difference, difference)), difference, s, t)


def _clamped(values: Array) -> Array:
    return np.minimum(np.maximum(values, 0.0), 1.0)

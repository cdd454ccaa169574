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
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs

TINY = 1e-12  # [length^2] keeps the quotients of zero-length segments finite
PARALLEL = 1e-12  # share of |u|^2 |v|^2 below which two directions count as parallel


@dataclass(frozen=True)
class Segment:
    """The axis of a capsule in symbols."""

    a: cs.SX  #: one end (3,)
    b: cs.SX  #: the other end (3,)

    @classmethod
    def of(cls, ends: cs.SX) -> Segment:
        """From both ends in one vector (6,)."""
        return cls(ends[:3], ends[3:])

    @property
    def ends(self) -> cs.SX:
        """Both ends (6,)."""
        return cs.vertcat(self.a, self.b)

    def point(self, share: cs.SX) -> cs.SX:
        """The point (3,) at a share of the way from a to b."""
        return self.a + share * (self.b - self.a)


def _clamp(value: cs.SX) -> cs.SX:
    return cs.fmin(cs.fmax(value, 0.0), 1.0)


def nearest_shares(one: Segment, two: Segment) -> tuple[cs.SX, cs.SX]:
    """Shares s and t, in [0, 1], of the nearest points of two segments; finite everywhere."""
    u, v, r = one.b - one.a, two.b - two.a, one.a - two.a
    a, e = cs.sumsqr(u) + TINY, cs.sumsqr(v) + TINY
    b, c, f = cs.dot(u, v), cs.dot(u, r), cs.dot(v, r)
    determinant = cs.fmax(a * e - b * b, PARALLEL * a * e + TINY)
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
    r"""The patent's one scalar a pair, which is to be >= 0: :math:`(d^2 - D^2) / (2 D)`.

    It has the value and the slope of d - D on the boundary, and no square root, whose derivative
    at contact is NaN.

    Args:
        one: A segment.
        two: Another.
        least: Least distance D > 0 of the two segments.
    """
    return (squared_distance(one, two) - least * least) / (2 * least)


def plane_gaps(normal: cs.SX, one: Segment, two: Segment) -> cs.SX:
    """Distances (4,) along a normal (3,) from the ends of ``two`` to the ends of ``one``.

    All four at least D, with a normal no longer than 1, prove the segments to be D apart.
    """
    return cs.vertcat(*(cs.dot(normal, p - q) for p in (one.a, one.b) for q in (two.a, two.b)))

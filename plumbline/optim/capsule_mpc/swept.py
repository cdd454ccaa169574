r"""What two capsules keep between two samples: the altitude of a triangle.

Let a step move all ends on straight lines at constant rates. Then every point of either axis does,
and for a point of each, their difference r moves on a straight line from :math:`r_0` to
:math:`r_1`, no farther than the ends do: :math:`|r_1 - r_0| \le \Delta`, the largest of the four
differences of two ends. With :math:`|r_0| \ge d_0`, :math:`|r_1| \ge d_1`, on all of the way

.. math:: d^2 \ge d_0^2 - 2\, \sigma s + \sigma^2, \qquad
          s = \frac{\Delta^2 + d_0^2 - d_1^2}{2 \Delta}, \quad
          \sigma = \min(\max(s, 0), \Delta)

the altitude on :math:`\Delta` of the triangle with the sides :math:`d_0, d_1, \Delta`, or the
shorter of the two sides where it falls outside. So D is kept if at both samples the distance is

.. math:: D' = \sqrt{D^2 + \Delta^2 / 4}

What moves on an arc leaves its chord by a sagitta, which is added to D (:mod:`.bodies`). No bound
on the distance at samples alone can do: shafts whose ends move farther than :math:`2 D` in a step
pass through each other between two samples that are both far apart.
"""

from __future__ import annotations

import casadi as cs

from plumbline.kinematics.capsules import TINY, Segment

POWER = 8  # of the norm, which exceeds the largest of four by 4^(1/8), 19 % of its square, at most
Axes = tuple[Segment, Segment]


def farthest(now: Axes, before: Axes) -> cs.SX:
    """Square of the most that a point of one axis moves as seen from one of the other [mm^2].

    The largest of the four differences of two ends, from above by a norm that has no kink: solvers
    of the nonlinear program do not converge on one.
    """
    moved = [
        [(a - b) for a, b in ((own.a, old.a), (own.b, old.b))]
        for own, old in zip(now, before, strict=True)
    ]
    squares = (cs.sumsqr(one - two) for one in moved[0] for two in moved[1])
    return sum((square**POWER for square in squares), cs.SX(TINY)) ** (1.0 / POWER)


def wide_enough(least: cs.SX, now: Axes, before: Axes) -> cs.SX:
    """Distance of two axes at both ends of a step that keeps them so far apart on the way [mm]."""
    return cs.sqrt(least**2 + farthest(now, before) / 4)


def on_the_way(first: cs.SX, last: cs.SX, moved2: cs.SX) -> cs.SX:
    """Least distance on the way [mm].

    Args:
        first: Squared distance before [mm^2].
        last: Squared distance after [mm^2].
        moved2: Square of the most that one point moves as seen from another [mm^2].
    """
    moved = cs.sqrt(moved2 + TINY)
    foot = (moved2 + first - last) / (2 * moved)
    inside = cs.fmin(cs.fmax(foot, 0.0), moved)
    return cs.sqrt(cs.fmax(first - 2 * inside * foot + inside**2, 0.0))

r"""A pair of capsules, and the distance that their axes must keep, at samples and between them.

.. math:: D = r_1 + r_2 + d_s + z \sqrt{\lambda_1^2 + \lambda_2^2}\, \sigma
          + (\lambda_1 + \lambda_2)\, b

with random errors :math:`\sigma` and a bias b of either body's points (:mod:`.settings`), and
:math:`\lambda` how far the point of the axis that is nearest moves of such an error: a shaft turns
about its trocar, so that of 0.1 mm at a tip 20 mm behind it, the other end makes 1.2 mm.

Let a step move all ends on straight lines at constant rates. Then the difference r of a point of
each axis moves on a straight line from :math:`r_0` to :math:`r_1`, no farther than the largest of
the four differences of two ends, :math:`\Delta`. With :math:`|r_0| \ge d_0`, :math:`|r_1| \ge d_1`,
on all of the way

.. math:: d^2 \ge d_0^2 - 2\, \sigma s + \sigma^2, \qquad
          s = \frac{\Delta^2 + d_0^2 - d_1^2}{2 \Delta}, \quad
          \sigma = \min(\max(s, 0), \Delta)

the altitude on :math:`\Delta` of the triangle with the sides :math:`d_0, d_1, \Delta`, or the
shorter of the two sides where it falls outside. So D is kept if at both samples the distance is
:math:`D' = \sqrt{D^2 + \Delta^2 / 4}`; what moves on an arc leaves its chord by a sagitta, which is
added to D (:mod:`.bodies`). No bound at samples alone can do: shafts whose ends move farther than
:math:`2 D` in a step pass through each other between two samples that are both far apart.

Two shafts through trocars are never farther apart than the trocars, wherever their tips are. Where
that is less than D, no motion mends it, and asking for it would drive tips away for nothing: the
shafts are to keep what the trocars allow, less a share that leaves them free to turn.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics.capsules import Segment, nearest_shares
from plumbline.kinematics.constants import TINY
from plumbline.optim.capsule_mpc.bodies import SymbolicCapsule
from plumbline.optim.capsule_mpc.constants import KEPT, POWER

Axes = tuple[Segment, Segment]


def farthest(now: Axes, before: Axes) -> cs.SX:
    """Square of the most that a point of one axis moves as seen from the other [mm^2], smoothly."""
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
    """Least distance on the way [mm], of squares before and after, and of the motion [mm^2]."""
    moved = cs.sqrt(moved2 + TINY)
    foot = (moved2 + first - last) / (2 * moved)
    inside = cs.fmin(cs.fmax(foot, 0.0), moved)
    return cs.sqrt(cs.fmax(first - 2 * inside * foot + inside**2, 0.0))


Lever = Callable[[cs.SX], cs.SX]


def unmoved(share: cs.SX) -> cs.SX:
    """An obstacle's place is known."""
    return cs.SX(0.0)


@dataclass(frozen=True)
class Moving:
    """A capsule in a step."""

    now: SymbolicCapsule  # where it is
    before: Segment  # its axis one step before
    bow: cs.SX  # how far its ends may leave their chords on the way from there [mm]
    through: cs.SX | None  # the point that its axis always passes through [mm], if any
    lever: Lever  # how far the point at a share of its axis moves, of an error of its body's
    label: str  # whose it is


@dataclass(frozen=True)
class Pair:
    """Two capsules that must keep their distance."""

    one: Segment  # axis of the first, a body's
    two: Segment  # axis of the second, a body's or an obstacle's
    radii: cs.SX  # sum of the radii [mm]
    plain: cs.SX  # least distance D of the axes where no error has a lever [mm]
    # how far a point at a share of either axis moves, of an error of its body's
    levers: tuple[Lever, Lever]
    # what of D is for random errors and for systematic ones of one body [mm]
    error: tuple[cs.SX, cs.SX]
    # distance of the points that both axes always pass through [mm], if they do: no motion brings
    # them farther apart
    most: cs.SX | None
    before: tuple[Segment, Segment]  # both axes one step before
    bow: cs.SX  # how far their ends may leave their chords on the way from there [mm]
    fixed: bool  # whether the second is an obstacle, on which the state has no influence
    ball: bool  # whether the second is a sphere
    labels: tuple[str, str]  # who they are: ``"1"`` for a body, ``"obstacle 1"``

    def least_at(self, s: cs.SX, t: cs.SX) -> cs.SX:
        """Least distance D of two points at shares s and t of the axes [mm]."""
        one, two = self.levers[0](s), self.levers[1](t)
        random, bias = self.error
        usual = np.sqrt(2.0) * random + 2 * bias
        if self.fixed:
            return self.plain + (one - 1) * (random + bias)
        return self.plain + cs.sqrt(one**2 + two**2) * random + (one + two) * bias - usual

    @cached_property
    def least(self) -> cs.SX:
        """Least distance D of the axes, at their nearest points [mm]."""
        return self.least_at(*nearest_shares(self.one, self.two))

    def wide(self, least: cs.SX) -> cs.SX:
        """The distance at both ends of a step that keeps a least one on all of the way [mm]."""
        wide = wide_enough(least + self.bow, (self.one, self.two), self.before)
        return wide if self.most is None else cs.fmin(wide, KEPT * self.most)

    @property
    def asked(self) -> cs.SX:
        """D, or what shafts keep whose trocars are nearer than that [mm]."""
        return self.least if self.most is None else cs.fmin(self.least, KEPT * self.most)

    @classmethod
    def of(
        cls,
        a: Moving,
        b: Moving,
        margin: cs.SX,
        fixed: bool,
        ball: bool = False,
        *,
        error: tuple[cs.SX, cs.SX],
        safe: float,
    ) -> Self:
        """Of two capsules, which are to stay ``safe`` and a margin apart [mm]."""
        most = None
        if a.through is not None and b.through is not None:
            most = cs.norm_2(a.through - b.through)
        return cls(
            a.now.axis,
            b.now.axis,
            cs.SX(a.now.radius + b.now.radius),
            a.now.radius + b.now.radius + safe + margin,
            (a.lever, b.lever),
            error,
            most,
            (a.before, b.before),
            a.bow + b.bow,
            fixed,
            ball,
            (a.label, b.label),
        )

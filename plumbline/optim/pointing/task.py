r"""The task of holding a needle on a lesion, in symbols of one posture.

.. math:: r(q) = \begin{pmatrix} (p(q) + \ell\, R(q)\, a - f) / \ell \\ E^T R(q)\, a \end{pmatrix},
          \qquad w(q) = \sqrt{\det J_r J_r^T}

with the flange at (R, p), the needle along a in its frame, the lesion f, :math:`\ell = l + r`, and
E two directions across the wanted one: three equations hold the tool centre point on the lesion,
two the direction. Turning about the needle is free. w is the manipulability of this task (Yoshikawa
1985, Int. J. Robotics Research 4(2), eq. 17); lengths are counted in :math:`\ell`, so that its
smallest singular value is in radians of the needle per radian of the joints.

Capsules that move with a posture: the arm's links, the needle, and the way it will be driven.

The arm is a chain of capsules from joint to joint: first along a joint's axis, then along the
normal to the next joint, as arms mostly are built. The needle is a capsule from flange to tip, its
path one from the tip to the lesion.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import constant
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing.aim import Aim, Needle
from plumbline.optim.pointing.constants import DAMPING, EQUATIONS, ROW


@dataclass(frozen=True, eq=False)
class NeedleTask:
    """Functions of one chain and of one direction of the needle in its flange."""

    chain: Chain  # the arm
    axis: tuple[float, float, float]  # the needle's direction (3,) in the flange's frame

    @cached_property
    def steps(self) -> Array:
        """What counts as one radian of each joint (n,): slides are counted in arm lengths [m]."""
        return np.where(self.chain.turning, 1.0, self.chain.reach)

    @cached_property
    def home(self) -> Array:
        """The middle of each joint's range (n,), 0 where it has no end [rad or m]."""
        bounded = np.isfinite(self.chain.lower) & np.isfinite(self.chain.upper)
        middle = (self.chain.lower + self.chain.upper) / 2
        return np.where(bounded, middle, 0.0)

    def point_and_needle(self, q: cs.SX, reach: cs.SX) -> tuple[cs.SX, cs.SX]:
        """Tool centre point (3,) [m] and direction of the needle (3,) at a posture (n,)."""
        T = self.chain.forward(q)
        needle = T.R @ constant(np.array(self.axis)[:, None])
        return T.t + reach * needle, needle

    def residual(self, q: cs.SX, row: cs.SX, across: cs.SX) -> cs.SX:
        """The five equations at a posture; ``across`` (3, 2) is E."""
        point, needle = self.point_and_needle(q, row[6])
        return cs.vertcat((point - row[:3]) / row[6], across.T @ needle)

    @cached_property
    def _seek(self) -> cs.Function:
        """Six equations, the direction as a difference: only the right sense is a zero of it."""
        q, row = cs.SX.sym("q", self.chain.n), cs.SX.sym("row", ROW)
        point, needle = self.point_and_needle(q, row[6])
        r = cs.vertcat((point - row[:3]) / row[6], needle - row[3:6])
        J = cs.jacobian(r, q) @ cs.diag(cs.DM(self.steps))
        both = [cs.densify(r), cs.densify(J.T)]
        return cs.Function("seek", [cs.vertcat(q, row)], both)

    def seek(self, q: Array, rows: Array) -> tuple[Array, Array]:
        """Residuals (N, 6) and Jacobians (N, 6, n) by steps of the joints, at postures (N, n)."""
        count, n = q.shape
        # A map is made for each number of rows: powers of two keep those few.
        table = np.zeros((1 << max(count - 1, 0).bit_length(), n + ROW))
        table[:count, :n], table[:count, n:] = q, rows
        table[count:, -1] = 1.0
        r, J = over_rows(self._seek, table)
        return r[:count, 0], J[:count]

    def least_motion(self, J: Array, r: Array) -> Array:
        """The shortest steps (N, n) that take residuals r (N, 6) away, barely damped."""
        J_transposed = J.transpose(0, 2, 1)
        square = J @ J_transposed + DAMPING * np.eye(r.shape[1])
        return -(J_transposed @ np.linalg.solve(square, r[..., None]))[..., 0]


@dataclass(frozen=True, eq=False)
class Bounded:
    """A task whose joints stay within limits."""

    task: NeedleTask  # the arm and its needle
    lower: Array  # limits (n,) [rad or m]
    upper: Array

    def clip(self, q: Array) -> Array:
        """Postures (N, n) within them."""
        return np.clip(q, self.lower, self.upper)


@lru_cache(maxsize=16)
def needle_task(chain: Chain, axis: tuple[float, float, float]) -> NeedleTask:
    """The task of a chain, made once."""
    return NeedleTask(chain, axis)


def across(needles: Array) -> Array:
    """Two unit directions (N, 3, 2) across each of some unit directions (N, 3)."""
    least = np.eye(3)[np.argmin(np.abs(needles), axis=1)]
    first = np.cross(needles, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(needles, first)], axis=2)


def smallest_singular_values(task: NeedleTask, q: Array, rows: Array) -> Array:
    """Smallest singular value (N,) of the task at postures (N, n): a sixth is always zero."""
    _, J = task.seek(q, rows)
    return np.asarray(np.linalg.svd(J, compute_uv=False)[:, EQUATIONS - 1], dtype=np.float64)


def corners(chain: Chain, q: cs.SX) -> cs.SX:
    """Points (3, 2 n + 2) along the arm at a posture: origins, and corners between them [m]."""
    frames = chain.joint_frames(q)
    points = [cs.SX(3, 1)]
    for joint, T, following in zip(chain.joints, frames, frames[1:], strict=False):
        axis = T.R @ constant(joint.axis[:, None])
        points += [T.t, T.t + axis * cs.dot(axis, following.t - T.t)]
    points.append(frames[-1].t)
    return cs.horzcat(*points)


@lru_cache(maxsize=16)
def _points(chain: Chain) -> cs.Function:
    """The corners, and last the flange's axes as columns (3, 2 n + 5)."""
    q = cs.SX.sym("q", chain.n)
    return cs.Function(
        "points", [q], [cs.densify(cs.horzcat(corners(chain, q), chain.forward(q).R))]
    )


def links(chain: Chain, q: Array) -> Array:
    """Axes of the arm's capsules (N, 2 n + 1, 2, 3) at postures (N, n), base frame [m]."""
    points = over_rows(_points(chain), q)[0]
    return np.stack([points[:, :-4], points[:, 1:-3]], axis=2)


def link_names(chain: Chain) -> tuple[str, ...]:
    """What the arm's capsules are called (2 n + 1): two a joint, after that of the base."""
    return ("link base", *(f"link {name}" for name in chain.joint_names for _ in range(2)))


def radii(aim: Aim) -> Array:
    """Radii (2 n + 3,) of all capsules: links, needle, path [m]."""
    arm = np.full(2 * aim.chain.n + 1, aim.arm_radius)
    return np.append(arm, [aim.needle.radius, aim.needle.radius])


def moving(chain: Chain, held: Needle, q: Array) -> Array:
    """Axes of all capsules (N, 2 n + 3, 2, 3) at postures (N, n): links, needle, path [m]."""
    points = over_rows(_points(chain), q)[0]
    # Columns of R come as rows: the flange's axes in the base frame.
    along = np.einsum("nji,j->ni", points[:, -3:], np.asarray(held.axis))
    top = points[:, -4]
    tip, centre = top + held.length * along, top + held.reach * along
    return _with_needle(np.stack([points[:, :-4], points[:, 1:-3]], axis=2), tip, top, centre)


def pointed(aim: Aim, q: Array, theta: Array, beta: Array) -> Array:
    """The same (N, 2 n + 3, 2, 3) with the needle where angles (N,) put it; links may be NaN."""
    u = aim.outward(theta, beta)
    tip, top = (aim.target + length * u for length in (aim.needle.standoff, aim.needle.reach))
    arm = np.full((len(q), 2 * aim.chain.n + 1, 2, 3), np.nan)
    there = np.isfinite(q).all(axis=1)
    arm[there] = links(aim.chain, q[there])
    return _with_needle(arm, tip, top, np.broadcast_to(aim.target, tip.shape))


def _with_needle(arm: Array, tip: Array, top: Array, centre: Array) -> Array:
    needle, path = np.stack([tip, top], axis=1), np.stack([centre, tip], axis=1)
    return np.concatenate([arm, needle[:, None], path[:, None]], axis=1)

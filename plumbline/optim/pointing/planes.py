r"""Planes that a path is asked to stay in front of, where it came too near something.

Two convex things are D apart if and only if some unit normal n has (Boyd and Vandenberghe 2004,
sec. 2.5.1)

.. math:: n \cdot a \ge n \cdot p + r + D \quad\text{for both ends } a \text{ of a capsule}

with p the point of the other thing that lies farthest along n. Coal gives n and p at the last path;
the path is planned again in front of these planes, and judged again (sequential convex
optimisation: Schulman et al. 2014, Int. J. Robotics Research 33(9), sec. 4). For a mesh, p is its
nearest point alone, so that the plane is right to first order only; that is for coal to judge.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.pointing.aim import Aim
from plumbline.optim.pointing.between import Between
from plumbline.optim.pointing.collision import corners, moving
from plumbline.optim.pointing.constants import NEAR, SLOTS
from plumbline.optim.pointing.surroundings import Pair, Surroundings
from plumbline.optim.pointing.task import NeedleTask


@dataclass(frozen=True, eq=False)
class Planes:
    """Rows of K angles, ``SLOTS`` each; those not in use are zero and ask nothing."""

    normals: Array  # (K, SLOTS, 3)
    offsets: Array  # least of what the points are along the normals (K, SLOTS) [m]
    weights: Array  # how the points of a posture add up (K, SLOTS, C)
    used: Array  # how many of an angle's are in use (K,)
    pairs: set[str]  # names of the pairs that they are of

    @classmethod
    def none(cls, count: int, task: NeedleTask) -> Planes:
        """No rows at all, for ``count`` angles."""
        C = points(task)
        shape = (count, SLOTS)
        return cls(
            np.zeros((*shape, 3)),
            np.zeros(shape),
            np.zeros((*shape, C)),
            np.zeros(count, int),
            set(),
        )

    @property
    def data(self) -> Array:
        """The same as parameters of the statement (K, SLOTS * (4 + C))."""
        parts = [self.normals, self.offsets[..., None], self.weights]
        return np.concatenate(parts, axis=2).reshape(len(self.offsets), -1)

    def add(
        self, k: int, around: Surroundings, share: float, pair: Pair, segments: Array, spare: float
    ) -> None:
        """Rows of angle k for a pair at some posture's capsules (M, 2, 3), ``spare`` [m] beyond."""
        _, point, normal = around.nearest(segments, pair)
        asked = float(around.radii[pair.capsule]) + pair.limit + spare
        count = self.weights.shape[2]
        rows = _ends(pair.capsule, count, share)
        if pair.thing >= 0:
            asked += float(normal @ point)
        else:
            asked += float(around.radii[pair.link])
            rows = [a - b for a in rows for b in _ends(pair.link, count, share)]
        if self.used[k] < SLOTS:
            self.pairs.add(pair.name)
        for weights in rows[: SLOTS - int(self.used[k])]:
            slot = int(self.used[k])
            self.normals[k, slot], self.offsets[k, slot] = normal, asked
            self.weights[k, slot] = weights
            self.used[k] += 1


def before_planes(
    aim: Aim, around: Surroundings, task: NeedleTask, q: Array, ways: Between, spare: float
) -> Planes:
    """Planes before all that a path (K, n) comes near, ``spare`` [m] beyond the limits."""
    planes = Planes.none(len(q), task)
    share = aim.needle.length / aim.needle.reach
    arm = np.flatnonzero(around.of_arm)
    # What is too near on the way asks both ends of it; the nearest first, as rows are few.
    for k in np.flatnonzero((ways.least - around.limits)[:, arm].min(axis=1) < 0.0).tolist():
        p = int(arm[(ways.least[k] - around.limits)[arm].argmin()])
        middle = q[k - 1] + ways.where[k, p] * (q[k] - q[k - 1])
        segments = moving(aim.chain, aim.needle, middle[None])[0]
        for end in (k - 1, k):
            planes.add(end, around, share, around.pairs[p], segments, spare)
    whole = np.flatnonzero(np.isfinite(q).all(axis=1))
    segments = moving(aim.chain, aim.needle, q[whole])
    bounds = around.bounds(segments) - around.limits
    for i, k in enumerate(whole.tolist()):
        near = [p for p in arm.tolist() if bounds[i, p] < NEAR]
        found = {p: around.distance(segments[i], around.pairs[p]) for p in near}
        spares = {p: value - around.pairs[p].limit for p, value in found.items()}
        for p in sorted(spares, key=lambda p: spares[p]):
            if spares[p] < NEAR:
                planes.add(k, around, share, around.pairs[p], segments[i], spare)
    return planes


def points(task: NeedleTask) -> int:
    """C, how many points of a posture rows are made of: corners and the tool centre point."""
    return 2 * task.chain.n + 3


def _ends(capsule: int, count: int, share: float) -> list[Array]:
    """Weights (C,) of a capsule's two ends: links first, then the needle, then its path."""
    unit = np.eye(count)
    flange, centre = unit[-2], unit[-1]
    tip = (1.0 - share) * flange + share * centre
    if capsule < count - 2:
        return [unit[capsule], unit[capsule + 1]]
    return [tip, flange] if capsule == count - 2 else [centre, tip]


def kept(task: NeedleTask, q: cs.SX, reach: cs.SX, planes: cs.SX) -> cs.SX:
    """By how much a posture (n,) keeps the rows (SLOTS,) [m] of one angle's ``data``."""
    point, _ = task.point_and_needle(q, reach)
    table = cs.reshape(planes, -1, SLOTS)
    ahead = cs.sum1(table[:3, :] * (cs.horzcat(corners(task.chain, q), point) @ table[4:, :]))
    return (ahead - table[3, :]).T

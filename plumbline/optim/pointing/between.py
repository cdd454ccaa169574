r"""What happens between the angles of a sweep: a bound where it suffices, coal where it does not.

Joints move in straight lines from one posture to the next. A point of the arm then stays within

.. math:: \varepsilon = \tfrac18 \sum_{a, b} |\Delta_a| |\Delta_b|\, h_{ab}, \qquad
          h_{ab} \ge \Bigl| \frac{\partial^2 p}{\partial q_a \partial q_b} \Bigr|

of the chord between its places at both ends, along which it goes in proportion (a chord's largest
distance from an arc; h is the farthest that the point can be from the outer one of two turning
joints, 1 if that one slides, 0 if both or the inner one do). With chords no longer than D for two
things together and the clearances d_0, d_1 at the ends, nothing on the way is nearer than

.. math:: d \ge \tfrac12 (d_0 + d_1 - D) - \varepsilon

since a distance changes by no more than its two sides move (Schwarzer, Saha, Latombe 2005, exact
collision checking of robot paths, with chords in place of path lengths). Pairs and stretches of the
way that this leaves open are halved, with coal at the middle.

Planes that a path is asked to stay in front of, where it came too near something.

Two convex things are D apart if and only if some unit normal n has (Boyd and Vandenberghe 2004,
sec. 2.5.1)

.. math:: n \cdot a \ge n \cdot p + r + D \quad\text{for both ends } a \text{ of a capsule}

with p the point of the other thing that lies farthest along n. Coal gives n and p at the last path;
the path is planned again in front of these planes, and judged again (sequential convex
optimisation: Schulman et al. 2014, Int. J. Robotics Research 33(9), sec. 4). For a mesh, p is its
nearest point alone, so that the plane is right to first order only; that is for coal to judge.
"""

from dataclasses import dataclass, replace
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.pointing.aim import Aim
from plumbline.optim.pointing.constants import NEAR, RESOLUTION, SLOTS
from plumbline.optim.pointing.status import Status
from plumbline.optim.pointing.surroundings import Clearance, ClearancePair, Surroundings, by_name
from plumbline.optim.pointing.task import NeedleTask, corners, moving


@dataclass(frozen=True, eq=False)
class Between:
    """Least clearances on the way to each of K angles from the one before."""

    least: Array  # by pair (K, P) [m]; infinite where the bound proves the limit without looking
    where: Array  # share of the way (K, P) at which that is

    def note(self, k: int, p: int, value: float, share: float) -> None:
        """A clearance of pair p [m] at a share of the way to angle k."""
        if value < self.least[k, p]:
            self.least[k, p], self.where[k, p] = value, share


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Parts of the way: I of them, with what is known of P pairs at both ends."""

    step: Indices  # (I,) number of the way
    start: Array  # (I,) share of the way
    end: Array
    d0: Array  # (I, P) clearances, or lower bounds of them [m]
    d1: Array
    segments0: Array  # (I, M, 2, 3) [m]
    segments1: Array
    asked: Flags  # (I, P) pairs that are open


def between(aim: Aim, around: Surroundings, q: Array, values: Array) -> Between:
    """Follow a path (K, n) with clearances (K, P) at its angles [m]; ways to NaN are left out."""
    K, P = values.shape
    found = Between(np.full((K, P), np.inf), np.zeros((K, P)))
    whole = np.asarray(np.isfinite(q).all(axis=1))
    steps = np.flatnonzero(whole[1:] & whole[:-1]) + 1
    if not (P and len(steps)):
        return found
    segments = np.full((K, len(around.radii), 2, 3), np.nan)
    segments[whole] = moving(aim.chain, aim.needle, q[whole])
    bend = curvatures(aim.chain, aim.needle.reach, q[whole])
    moves = np.abs(np.diff(q, axis=0))[steps - 1]
    sag = np.zeros((K, len(around.radii)))
    sag[steps] = np.einsum("ia,mab,ib->im", moves, bend, moves) / 8
    now = _Stretches(
        steps, np.zeros(len(steps)), np.ones(len(steps)), values[steps - 1], values[steps],
        segments[steps - 1], segments[steps], np.ones((len(steps), P), dtype=bool),
    )  # fmt: skip
    now = _sharpened(around, _open(around, now, sag, found))
    while len(now.step):
        now = _halved(aim, around, q, now, found)
        now = _open(around, now, sag, found)
    return found


def _open(around: Surroundings, now: _Stretches, sag: Array, found: Between) -> _Stretches:
    """The stretches and pairs that the bound leaves open; those too short to halve are settled."""
    chord = np.linalg.norm(now.segments1 - now.segments0, axis=3).max(axis=2)
    part = (now.end - now.start)[:, None]
    slack = chord / 2 + sag[now.step] * part**2
    one, _, link = around.indices
    loss = slack[:, one] + np.where(link >= 0, slack[:, link], 0.0)
    bound = (now.d0 + now.d1) / 2 - loss
    aim_for = np.minimum(around.limits, found.least[now.step] - RESOLUTION)
    still = now.asked & (bound < aim_for)
    settled = still & (loss < RESOLUTION / 2)
    for i, p in zip(*np.nonzero(settled), strict=True):
        found.note(now.step[i], p, bound[i, p], (now.start[i] + now.end[i]) / 2)
    still &= ~settled
    keep = still.any(axis=1)
    return _Stretches(**{k: v[keep] for k, v in vars(replace(now, asked=still)).items()})


def _sharpened(around: Surroundings, now: _Stretches) -> _Stretches:
    """The same with coal's distances at both ends in place of lower bounds."""
    d0, d1 = now.d0.copy(), now.d1.copy()
    for i, p in zip(*np.nonzero(now.asked), strict=True):
        d0[i, p] = around.distance(now.segments0[i], around.pairs[p])
        d1[i, p] = around.distance(now.segments1[i], around.pairs[p])
    return replace(now, d0=d0, d1=d1)


def _halved(
    aim: Aim, around: Surroundings, q: Array, now: _Stretches, found: Between
) -> _Stretches:
    """Both halves of every stretch, coal asked at their middle about what is open."""
    share = (now.start + now.end) / 2
    middle = q[now.step - 1] + share[:, None] * (q[now.step] - q[now.step - 1])
    segments = moving(aim.chain, aim.needle, middle)
    d = np.full(now.d0.shape, np.inf)
    for i, p in zip(*np.nonzero(now.asked), strict=True):
        d[i, p] = around.distance(segments[i], around.pairs[p])
        found.note(now.step[i], p, d[i, p], share[i])
    first = vars(replace(now, end=share, d1=d, segments1=segments))
    second = vars(replace(now, start=share, d0=d, segments0=segments))
    return _Stretches(**{k: np.concatenate([first[k], second[k]]) for k in first})


def curvatures(chain: Chain, reach: float, q: Array) -> Array:
    """Bounds h (M, n, n) on second derivatives of points of all capsules [m/rad^2]."""
    n, slides = chain.n, ~chain.turning
    out = np.where(slides, np.abs(q).max(axis=0), 0.0)
    lengths = [np.linalg.norm(joint.T_parent_joint[:3, 3]) for joint in chain.joints[1:]]
    lengths.append(np.linalg.norm(chain.T_last_tip[:3, 3]))
    # From a joint's origin to the next one's, and from the last to the flange.
    far = np.array(lengths) + np.append(out[1:], 0.0)
    found = np.zeros((2 * n + 3, n, n))
    for m in range(2 * n + 3):
        carrier = min((m + 1) // 2 - 1, n - 1)  # -1: the base
        ahead = np.cumsum(far[: carrier + 1][::-1])[::-1] + (reach if m > 2 * n else 0.0)
        h = np.append(ahead, np.zeros(n - len(ahead)))
        h = np.where(slides, np.where(np.arange(n) <= carrier + 1, 1.0, 0.0), h)
        outer = np.maximum.outer(np.arange(n), np.arange(n))
        inner = np.minimum.outer(np.arange(n), np.arange(n))
        found[m] = np.where(slides[inner], 0.0, h[outer])
    return found


def with_ways(
    status: tuple[Status, ...], reasons: tuple[str, ...], around: Surroundings, ways: Between
) -> tuple[tuple[Status, ...], tuple[str, ...]]:
    """Statuses with what comes too near on the way from one safe angle to the next."""
    kinds, words = list(status), list(reasons)
    if not len(around.pairs):
        return status, reasons
    short = ways.least - around.limits
    for k in np.flatnonzero(short.min(axis=1) < 0.0).tolist():
        if status[k] == status[k - 1] == Status.SAFE:
            p = int(short[k].argmin())
            pair, value = around.pairs[p], float(ways.least[k, p])
            found = Clearance(pair.first, pair.second, value, pair.limit, k)
            kinds[k], words[k] = Status.COLLISION, f"on the way there {found.words}"
    return tuple(kinds), tuple(words)


def whole_way(
    around: Surroundings, q: Array, at_angles: Array, ways: Between
) -> tuple[Clearance, ...]:
    """Least clearances by name along a path (K, n), at its angles (K, P) and between them."""
    held = np.asarray(np.isfinite(q).all(axis=1))
    both = np.concatenate([np.where(held[:, None], at_angles, np.inf), ways.least])
    if not both.size:
        return ()
    k, step = both.argmin(axis=0), np.arange(len(at_angles))[:, None]
    places = np.concatenate([np.broadcast_to(step, at_angles.shape), step - 1 + ways.where])
    return by_name(around.pairs, both.min(axis=0), places[k, np.arange(both.shape[1])])


@dataclass(frozen=True, eq=False)
class Planes:
    """Rows of K angles, ``SLOTS`` each; those not in use are zero and ask nothing."""

    normals: Array  # (K, SLOTS, 3)
    offsets: Array  # least of what the points are along the normals (K, SLOTS) [m]
    weights: Array  # how the points of a posture add up (K, SLOTS, C)
    used: Array  # how many of an angle's are in use (K,)
    pairs: set[str]  # names of the pairs that they are of

    @classmethod
    def none(cls, count: int, task: NeedleTask) -> Self:
        """No rows at all, for ``count`` angles."""
        normals, offsets, weights = (
            np.zeros((count, SLOTS, *k)) for k in ((3,), (), (points(task),))
        )
        return cls(normals, offsets, weights, np.zeros(count, int), set())

    @property
    def data(self) -> Array:
        """The same as parameters of the statement (K, SLOTS * (4 + C))."""
        parts = [self.normals, self.offsets[..., None], self.weights]
        return np.concatenate(parts, axis=2).reshape(len(self.offsets), -1)

    def add(
        self,
        k: int,
        around: Surroundings,
        share: float,
        pair: ClearancePair,
        segments: Array,
        spare: float,
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
        for slot, weights in zip(range(int(self.used[k]), SLOTS), rows, strict=False):
            self.normals[k, slot], self.offsets[k, slot] = normal, asked
            self.weights[k, slot], self.used[k] = weights, slot + 1


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

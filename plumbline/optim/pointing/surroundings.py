r"""Every pair that must not meet, its limit, and its distance by coal.

Capsules move (:mod:`plumbline.optim.pointing.task`), solids stand. What is known of a pair
without asking coal is a lower bound, from the spheres of half sizes R about two middles,

.. math:: d_{ij} \ge |c_i - c_j| - R_i - R_j

and from a half-space the lower of a capsule's two ends.
Coal is asked for every pair that could be a posture's nearest, or over all postures its nearest to
its solid; both of these are therefore coal's own numbers.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import coal
import numpy as np

from plumbline.kinematics.capsules import nearest
from plumbline.kinematics.chain import Chain
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.pointing.aim import Aim, Needle
from plumbline.optim.pointing.body import Shape, turning_z_to
from plumbline.optim.pointing.constants import MM, ROUNDING, SAMPLES, SHORTEST, STILL
from plumbline.optim.pointing.mesh import Mesh
from plumbline.optim.pointing.postures import starts
from plumbline.optim.pointing.task import link_names, moving, needle_task, radii


@dataclass(frozen=True, eq=False)
class Thing:
    """A shape where it stands."""

    name: str  # what answers call it
    shape: Shape  # in coordinates of its own
    limit: float  # least clearance from it [m]
    T_given: Array  # the frame of those coordinates in the robot's base (4, 4) [m]
    keeps_path: bool  # whether the needle's path must miss it
    in_room: bool  # whether the arm is mounted beside it, so that what never moves may touch it

    @cached_property
    def T(self) -> Array:
        """The shape's own frame in the robot's base (4, 4) [m]."""
        return self.T_given @ self.shape.placement

    @cached_property
    def body(self) -> coal.CollisionObject:
        """The same for coal [mm]."""
        return coal.CollisionObject(self.shape.shape(), self.T[:3, :3], MM * self.T[:3, 3])

    def surrounds(self, point: Array) -> bool:
        """Whether a surface of triangles has a point (3,) of the robot's base [m] inside."""
        local = (point - self.T_given[:3, 3]) @ self.T_given[:3, :3]
        return isinstance(self.shape, Mesh) and bool(self.shape.contains(local)[0])


@dataclass(frozen=True)
class ClearancePair:
    """Two things that must keep a distance."""

    first: str  # name of what moves
    second: str  # name of what it must not meet
    limit: float  # least clearance [m]
    capsule: int  # which of a posture's capsules it is
    thing: int = -1  # which of the standing things the second is, -1 if it is a link
    link: int = -1  # which of the posture's capsules the second is, -1 if it stands

    @property
    def name(self) -> str:
        """Both names."""
        return f"{self.first}, {self.second}"


@dataclass(frozen=True)
class Clearance:
    """How near two things come, by name."""

    first: str  # what moves: a link, the needle, its path
    second: str  # what it must not meet
    distance: float  # least clearance found [m]; below 0 they are in each other
    limit: float  # what it has to be at least [m]
    where: float  # index of the angle; a fraction lies on the way to the next

    @property
    def words(self) -> str:
        """What it comes to, in one line."""
        near = "comes near" if self.distance < self.limit else "keeps clear of"
        meets = "meets" if self.distance < 0.0 else near
        # As many digits as tell the value from its limit.
        digits = 1 if abs(self.distance - self.limit) > 1e-4 else 4
        return (
            f"{self.first} {meets} {self.second}: clearance {1e3 * self.distance:.{digits}f} mm "
            f"(limit {1e3 * self.limit:g})"
        )


def by_name(pairs: Sequence[ClearancePair], values: Array, where: Array) -> tuple[Clearance, ...]:
    """Of pairs (P) of equal names the one that falls shortest, the shortest of all first."""
    found: dict[tuple[str, str], Clearance] = {}
    for pair, value, place in zip(pairs, values.tolist(), where.tolist(), strict=True):
        key = (pair.first, pair.second)
        if np.isfinite(value) and (key not in found or value < found[key].distance):
            found[key] = Clearance(*key, value, pair.limit, place)
    return tuple(sorted(found.values(), key=lambda c: c.distance - c.limit))


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Pairs of an aim that must not meet."""

    things: tuple[Thing, ...]  # what stands
    pairs: tuple[ClearancePair, ...]  # what must keep which distance (P)
    radii: Array  # of a posture's capsules (M,) [m]
    # pairs that meet by the arm's build or mounting, whatever its posture, by name
    left_out: tuple[str, ...]

    @cached_property
    def limits(self) -> Array:
        """Least clearances (P,) [m]."""
        return np.array([pair.limit for pair in self.pairs])

    @cached_property
    def on_path(self) -> Flags:
        """Which pairs (P,) are of the needle's path and a standing thing: no posture mends them."""
        last = len(self.radii) - 1
        return np.array([p.capsule == last and p.thing >= 0 for p in self.pairs], dtype=bool)

    @cached_property
    def of_arm(self) -> Flags:
        """Which pairs (P,) depend on the posture that holds the needle."""
        arm = len(self.radii) - 2
        return np.array([p.capsule < arm or p.link >= 0 for p in self.pairs], dtype=bool)

    def bounds(self, segments: Array) -> Array:
        """Lower bounds of the clearances (N, P) at capsules (N, M, 2, 3) [m]."""
        lengths = np.linalg.norm(segments[:, :, 1] - segments[:, :, 0], axis=2)
        longest = lengths.max(axis=0, where=lengths >= 0.0, initial=0.0)
        absent = np.isnan(lengths) | (longest <= SHORTEST)
        middle, half = segments.mean(axis=2), lengths / 2 + self.radii
        one, thing, link = self.indices
        there = np.array([*(t.T[:3, 3] for t in self.things), np.zeros(3)])
        size = np.array([*(t.shape.half_size for t in self.things), 0.0])
        stands = thing >= 0
        second = np.where(stands[:, None], there[thing], middle[:, link])
        away = np.linalg.norm(middle[:, one] - second, axis=2)
        found = away - half[:, one] - np.where(stands, size[thing], half[:, link])
        for k in np.flatnonzero(np.isinf(size)):
            T = self.things[k].T
            height = ((segments - T[:3, 3]) @ T[:3, 2]).min(axis=2) - self.radii - ROUNDING
            found = np.where(thing == k, height[:, one], found)
        return np.where(absent[:, one] | (absent[:, link] & ~stands), np.inf, found)

    @cached_property
    def indices(self) -> tuple[Indices, Indices, Indices]:
        """Of every pair its capsule, its thing and its link (P,) each."""
        found = np.array([(p.capsule, p.thing, p.link) for p in self.pairs], dtype=np.intp)
        return found[:, 0], found[:, 1], found[:, 2]

    def distance(self, segments: Array, pair: ClearancePair) -> float:
        """Signed clearance [m] of one pair at one posture's capsules (M, 2, 3), by coal."""
        return self.nearest(segments, pair)[0]

    def nearest(self, segments: Array, pair: ClearancePair) -> tuple[float, Array, Array]:
        """The same, with a point of the second (3,) [m] and the normal (3,) towards the first."""
        one = _capsule(segments[pair.capsule], self.radii[pair.capsule])
        if pair.thing < 0:
            two = _capsule(segments[pair.link], self.radii[pair.link])
        else:
            two = self.things[pair.thing].body
        result = coal.DistanceResult()
        found = float(coal.distance(two, one, coal.DistanceRequest(), result)) / MM
        point, normal = result.getNearestPoint1() / MM, np.array(result.normal)
        if (
            pair.thing >= 0
            and found > 0
            and self.things[pair.thing].surrounds(segments[pair.capsule, 0])
        ):
            return -found - 2 * float(self.radii[pair.capsule]), point, -normal
        return found, point, normal

    def clear(self, segments: Array) -> Flags:
        """Which postures (N,) keep all limits: coal is asked where the bounds do not say so."""
        found = np.ones(len(segments), dtype=bool)
        short = self.bounds(segments) < self.limits if len(self.pairs) else np.zeros((0, 0))
        for k, p in zip(*np.nonzero(short), strict=True):
            if found[k]:
                found[k] = self.distance(segments[k], self.pairs[p]) >= self.pairs[p].limit
        return found

    def table(self, segments: Array, pairs_too: bool = True) -> Array:
        """Clearances (N, P) [m] at capsules (N, M, 2, 3); lower bounds but for coal's.

        Coal is asked for each posture's nearest and, if that is said, each pair's; infinite where a
        capsule has no length or no place.
        """
        if not len(self.pairs):
            return np.empty((len(segments), 0))
        values = self.bounds(segments)
        exact = np.isposinf(values)
        rows, columns = np.arange(len(values)), np.arange(len(self.pairs))
        nowhere = np.asarray(np.isnan(segments).any(axis=(1, 2, 3)))[:, None]
        while True:
            todo = np.zeros(values.shape, dtype=bool)
            todo[rows, values.argmin(axis=1)] = True
            # What falls shortest on the path, and of the rest: verdicts ask for them apart.
            for which in (self.on_path, ~self.on_path):
                short = np.where(which, values - self.limits, np.inf)
                todo[rows, short.argmin(axis=1)] |= which.any()
            if pairs_too:
                todo[np.where(nowhere, np.inf, values).argmin(axis=0), columns] = True
            todo &= ~exact
            if not todo.any():
                return values
            for k, p in zip(*(index.tolist() for index in np.nonzero(todo)), strict=True):
                values[k, p] = self.distance(segments[k], self.pairs[p])
            exact |= todo


def _capsule(segment: Array, radius: float) -> coal.CollisionObject:
    """Coal's capsule [mm] about a segment (2, 3) [m]."""
    along = segment[1] - segment[0]
    length = float(np.linalg.norm(along))
    R = turning_z_to(along) if length > SHORTEST else np.eye(3)
    return coal.CollisionObject(
        coal.Capsule(MM * radius, MM * length), R, MM * (segment[0] + segment[1]) / 2
    )


def surroundings(aim: Aim, least_clearance: float) -> Surroundings:
    """What an aim's arm, needle and path must keep from [m]: body, scene, and the arm itself."""
    if aim.body is None and aim.scene is None:
        return Surroundings((), (), radii(aim), ())
    names = link_names(aim.chain)
    needle, path = len(names), len(names) + 1
    arm = list(enumerate(names))
    near = aim.arm_radius + aim.needle.radius + least_clearance
    mounted, built_in = _by_build(aim.chain, aim.needle, near)
    things, pairs = _standing(aim, least_clearance), []
    for k, thing in enumerate(things):
        capsules = [c for c in arm if not (thing.in_room and c[0] in mounted)]
        capsules += [(needle, "needle")] + [(path, "needle path")] * thing.keeps_path
        pairs += [ClearancePair(name, thing.name, thing.limit, i, thing=k) for i, name in capsules]
    for i, first in ((needle, "needle"), (path, "needle path")):
        pairs += [
            ClearancePair(first, name, least_clearance, i, link=j)
            for j, name in arm
            if j not in built_in
        ]
    beside = {j for thing in things if thing.in_room for j in mounted}
    left = _unjudged(names, built_in, "needle") + _unjudged(names, beside, "room")
    return Surroundings(things, tuple(pairs), radii(aim), left)


def _unjudged(names: tuple[str, ...], out: Collection[int], beside: str) -> tuple[str, ...]:
    """Links of which no capsule is judged, with what they are not judged against."""
    whole = [name for name in names if all(j in out for j, n in enumerate(names) if n == name)]
    return tuple(f"{name}, {beside}" for name in dict.fromkeys(whole))


def _standing(aim: Aim, least: float) -> tuple[Thing, ...]:
    """The body, the anatomy and the room."""
    found, T = [], aim.T_robot_ct
    if aim.body is not None:
        found.append(Thing("body", aim.body, least, T, keeps_path=False, in_room=False))
    if aim.scene is None:
        return tuple(found)
    for solids, frame, in_room in (
        (aim.scene.anatomy, T, False),
        (aim.scene.room, np.eye(4), True),
    ):
        for solid in solids:
            limit = least if solid.margin is None else float(solid.margin)
            found.append(Thing(solid.name, solid.shape, limit, frame, not solid.enter, in_room))
    return tuple(found)


@lru_cache(maxsize=16)
def _by_build(chain: Chain, needle: Needle, near: float) -> tuple[frozenset[int], frozenset[int]]:
    """Capsules that never move, and those that the flange never leaves or keeps at one distance."""
    q = starts(needle_task(chain, needle.axis), SAMPLES)
    segments = moving(chain, needle, q)
    arm = segments[:, :-2]
    still = np.ptp(arm, axis=0).max(axis=(1, 2)) < STILL
    flange = np.repeat(arm[:, -1:, 1:], 2, axis=2)
    inside = (_apart(arm, flange) < near).all(axis=0)
    inside |= np.ptp(_apart(arm, segments[:, -2:-1]), axis=0) < STILL
    inside[-2:] = True  # the link that carries the needle
    return frozenset(np.flatnonzero(still).tolist()), frozenset(np.flatnonzero(inside).tolist())


def _apart(many: Array, one: Array) -> Array:
    """Distances (N, M) [m] of segments (N, M, 2, 3) from one each (N, 1, 2, 3)."""
    ones = np.broadcast_to(one, many.shape).reshape(-1, 2, 3)
    found = nearest(MM * many.reshape(-1, 2, 3), MM * ones).distance
    return found.reshape(many.shape[:2]) / MM

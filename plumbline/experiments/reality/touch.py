r"""Clearances of capsules by coal, which shares no code with what plans them; lengths in mm.

A long motion is looked at in two ways. Plain arithmetic finds the distance of every pair at every
moment: the nearest points of two segments lie inside of both, or at an end of one, so that

.. math:: d^2 = \min\big(d^2_{inside},\ d^2(a_1, v),\ d^2(b_1, v),\ d^2(a_2, u),\ d^2(b_2, u)\big)

with the first only where the lines' nearest points lie inside of both segments. Coal is asked
wherever this comes to the least of a pair or into contact, and at a share of all other moments; the
two must agree, and coal's word is what is reported.

Coal's test of two capsules has an absolute threshold meant for numbers of some size: in metres,
capsules shorter than 2 cm are wrong by up to half a millimetre. In mm the same data agree with
long arithmetic to 1e-5 mm where shafts are nearly parallel, and to 1e-12 mm elsewhere.
"""

from dataclasses import dataclass

import coal
import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arm import Array

AGREE = 1e-3  # [mm] between coal and plain arithmetic; coal errs by 1e-5 where shafts are parallel
SHARE = 199  # every so manieth moment of the rest is asked too
PARALLEL = 1e-12  # share of |u|^2 |v|^2 below which the lines' nearest points mean nothing


def placement(ends: Array) -> tuple[float, Array, Array]:
    """Length [mm], rotation (3, 3) and middle (3,) of a capsule along its own z axis."""
    way = ends[1] - ends[0]
    length = float(np.sqrt(way @ way))
    z = way / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    x = np.zeros(3)
    x[int(np.argmin(np.abs(z)))] = 1.0
    x = x - (z @ x) * z
    x /= np.sqrt(x @ x)
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    return length, np.column_stack([x, y, z]), (ends[0] + ends[1]) / 2


@dataclass(frozen=True)
class Closest:
    """How near a motion came."""

    clearance: float  # the least of all pairs and moments, by coal [mm]
    moment: int  # number of the moment at which it was found
    looked: int  # pairs and moments that were looked at
    asked: int  # how many of them coal was asked about


@dataclass(frozen=True, eq=False)
class Touch:
    """Asks coal about pairs of capsules."""

    pairs: NDArray[np.intp]  # which capsules (K, 2) to compare, by their numbers
    radii: Array  # radii (C,) [mm] of all capsules

    def clearances(self, ends: Array) -> Array:
        """Clearance of every pair (K,) [mm], negative in penetration; ends (C, 2, 3) [mm]."""
        shapes, places = [], []
        for k, radius in enumerate(self.radii):
            length, R, middle = placement(ends[k])
            shapes.append(coal.Capsule(float(radius), length))
            places.append(coal.Transform3s(R, middle))
        request, found = coal.DistanceRequest(), np.empty(len(self.pairs))
        for n, (i, j) in enumerate(self.pairs):
            result = coal.DistanceResult()
            found[n] = coal.distance(shapes[i], places[i], shapes[j], places[j], request, result)
        return found

    def least(self, ends: Array) -> Closest:
        """The least clearance of a motion (T, C, 2, 3) [mm], over all pairs and moments."""
        if not len(self.pairs):
            return Closest(np.inf, 0, len(ends), 0)
        one, two = ends[:, self.pairs[:, 0]], ends[:, self.pairs[:, 1]]
        gaps = segment_distances(one, two) - self.radii[self.pairs].sum(axis=1)
        ask = (gaps < 0.0) | (gaps <= gaps.min(axis=0))
        ask.ravel()[::SHARE] = True
        found = np.full(gaps.shape, np.inf)
        for t in np.nonzero(ask.any(axis=1))[0]:
            chosen = np.nonzero(ask[t])[0]
            found[t, chosen] = Touch(self.pairs[chosen], self.radii).clearances(ends[t])
        worst = float(np.abs(found - gaps)[ask].max())
        if not worst <= AGREE:
            raise RuntimeError(f"coal and arithmetic differ by {worst:.2g} mm, at most {AGREE:g}")
        moment = int(np.argmin(found.min(axis=1)))
        return Closest(float(found.min()), moment, gaps.size, int(ask.sum()))


def _to_segment(point: Array, a: Array, way: Array) -> Array:
    """Squared distance (...,) of points from segments that begin at a."""
    length2 = np.vecdot(way, way)
    share = np.vecdot(point - a, way) / np.where(length2 > 0.0, length2, 1.0)
    off = point - a - np.clip(share, 0.0, 1.0)[..., None] * way
    return np.asarray(np.vecdot(off, off))


def point_distances(points: Array, segments: Array) -> Array:
    """Distances (...,) of points (..., 3) from segments (..., 2, 3)."""
    a, b = np.moveaxis(segments, -2, 0)
    return np.asarray(np.sqrt(_to_segment(points, a, b - a)))


def segment_distances(one: Array, two: Array) -> Array:
    """Distances (...,) of segments (..., 2, 3) from segments (..., 2, 3)."""
    (a, b), (c, d) = (np.moveaxis(s, -2, 0) for s in (one, two))
    u, v, r = b - a, d - c, a - c
    found = np.minimum(_to_segment(a, c, v), _to_segment(b, c, v))
    found = np.minimum(found, np.minimum(_to_segment(c, a, u), _to_segment(d, a, u)))
    uu, vv, uv = np.vecdot(u, u), np.vecdot(v, v), np.vecdot(u, v)
    ur, vr = np.vecdot(u, r), np.vecdot(v, r)
    across = uu * vv - uv * uv
    crossed = across > PARALLEL * uu * vv
    safe = np.where(crossed, across, 1.0)
    s, t = (uv * vr - vv * ur) / safe, (uu * vr - uv * ur) / safe
    inside = crossed & (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
    between = r + s[..., None] * u - t[..., None] * v
    found = np.where(inside, np.minimum(found, np.vecdot(between, between)), found)
    return np.asarray(np.sqrt(found))


def all_pairs(moving: int, standing: int) -> NDArray[np.intp]:
    """Every two of the moving capsules, and each of them with each of the others (K, 2)."""
    own = [(i, j) for i in range(moving) for j in range(i + 1, moving)]
    other = [(i, moving + j) for i in range(moving) for j in range(standing)]
    return np.array([*own, *other], dtype=np.intp).reshape(-1, 2)

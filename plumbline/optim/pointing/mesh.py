r"""A closed surface of triangles, as a segmentation of a CT gives it; coal has its distances.

A distance to a surface does not tell inside from outside. The winding number does (Jacobson,
Kavan, Sorkine-Hornung 2013, eq. 5), the solid angle of all triangles seen from a point p,

.. math:: w(p) = \frac{1}{4\pi} \sum_f \Omega_f(p), \qquad
          \tan\frac{\Omega_f}{2} = \frac{a \cdot (b \times c)}
          {|a||b||c| + (a \cdot b)|c| + (b \cdot c)|a| + (c \cdot a)|b|}

(Van Oosterom and Strackee 1983), with a, b, c from p to the corners: :math:`\pm 1` inside, 0
outside, provided that the surface has no border.

What is around a needle: organs, vessels and bones in CT, table and stands in the robot's frame.

Every solid has a name, by which answers speak of it, and says how near it may be come to. A solid
that the needle may enter still keeps the arm out, and the needle as long as it stands off.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self, get_args

import coal
import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import Declared, NotNegative, expect
from plumbline.errors import PlumblineError
from plumbline.kinematics.frames import homogeneous
from plumbline.optim.core.answer import register_kinds
from plumbline.optim.core.problem import Array, Flags, Integers
from plumbline.optim.pointing import constants
from plumbline.optim.pointing.body import Body, Box, Capsule, Cylinder, HalfSpace, Sphere
from plumbline.optim.pointing.given import array
from plumbline.optim.triangles import triangles_of


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface of triangles, all turned alike."""

    vertices: Array  # corners (V, 3) [m]
    triangles: Integers  # indices of three corners each (F, 3)

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike) -> None:
        """Check that the surface is closed.

        Args:
            vertices: Corners (V, 3) [m]; repeated ones are joined.
            triangles: Indices (F, 3) of the corners, from 0.

        Raises:
            PlumblineError: Not numbers, indices out of range, a border, or no volume.
        """
        points = _checked_vertices(vertices)
        faces = _checked_triangles(triangles, len(points))
        points, joined = np.unique(points, axis=0, return_inverse=True)
        faces = joined.reshape(-1)[faces]
        whole = np.ptp(faces, axis=1) > 0
        for a, b in ((0, 1), (1, 2), (2, 0)):
            whole &= faces[:, a] != faces[:, b]
        faces = faces[whole]
        _closed(points, faces)
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "triangles", faces)

    def __repr__(self) -> str:
        return f"<Mesh of {len(self.vertices)} corners and {len(self.triangles)} triangles>"

    @classmethod
    def from_file(cls, path: str | Path, unit: float = 1e-3) -> Self:
        """A surface from an STL, OBJ or PLY file, in the file's own coordinates.

        Args:
            path: The file.
            unit: Its unit [m]; segmentations of a CT are written in millimetres.

        Raises:
            PlumblineError: It is no such file, or too large, or its surface is not closed.
        """
        corners, faces = triangles_of(Path(path), constants.LARGEST_FILE)
        return cls(unit * corners, faces)

    @cached_property
    def middle(self) -> Array:
        """Middle of the box along the axes that holds it (3,) [m]."""
        return (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2

    @property
    def placement(self) -> Array:
        """Its middle (4, 4) [m]."""
        return homogeneous(np.eye(3), self.middle)

    @cached_property
    def half_size(self) -> float:
        """Radius of the sphere about its middle that holds it [m]."""
        return float(np.linalg.norm(self.vertices - self.middle, axis=1).max())

    @cached_property
    def _coal(self) -> coal.CollisionGeometry:
        model: Any = coal.BVHModelOBBRSS()
        model.beginModel(len(self.triangles), len(self.vertices))
        model.addVertices(constants.MM * (self.vertices - self.middle))
        model.addTriangles(self.triangles)
        model.endModel()
        model.computeLocalAABB()
        return model

    def shape(self) -> coal.CollisionGeometry:
        """Coal's tree of triangles [mm]; made once."""
        return self._coal

    def contains(self, points: ArrayLike) -> Flags:
        """Which points (N, 3) [m] lie inside, in the coordinates of the vertices."""
        asked = np.atleast_2d(np.asarray(points, dtype=float))
        inside = ((asked >= self.vertices.min(axis=0)) & (asked <= self.vertices.max(axis=0))).all(
            axis=1
        )
        near = np.flatnonzero(inside)
        for part in np.array_split(near, 1 + len(near) * len(self.triangles) // constants.CHUNK):
            inside[part] = np.abs(_winding(asked[part], self.vertices[self.triangles])) > 0.5
        return inside

    def depth(self, point: Array, towards: Array) -> Array:
        """How far (N,) [m] the last crossing lies (Moeller, Trumbore 1997); below 0 outside."""
        if not self.contains(point)[0]:
            return np.full(len(towards), -1.0)
        a, b, c = np.moveaxis(self.vertices[self.triangles], 1, 0)
        first, second, back = b - a, c - a, point - a
        across = np.cross(back, first)
        t_part = np.vecdot(second, across)
        found = np.zeros(len(towards))
        for k, d in enumerate(towards):
            p = np.cross(d, second)
            det = np.vecdot(first, p)
            with np.errstate(divide="ignore", invalid="ignore"):
                u, v, t = np.vecdot(back, p) / det, (across @ d) / det, t_part / det
                inside = np.minimum(np.minimum(u, v), 1 - u - v) >= -constants.ROUNDING
            found[k] = t[inside & (t > 0)].max(initial=0.0)
        return found


def _checked_vertices(vertices: ArrayLike) -> Array:
    hint = "give corners (V, 3) in m"
    if np.ndim(vertices) != 2 or np.shape(vertices)[0] < 4:
        raise PlumblineError(
            f"mesh vertices: shape {np.shape(vertices)}, at least (4, 3) expected; {hint}"
        )
    return array(vertices, "mesh vertices", (np.shape(vertices)[0], 3), hint)


def _checked_triangles(triangles: ArrayLike, count: int) -> Integers:
    if np.ndim(triangles) != 2 or np.shape(triangles)[0] < 4:
        raise PlumblineError(
            f"mesh triangles: shape {np.shape(triangles)}, at least (4, 3) expected; a closed "
            "surface has four"
        )
    hint = "give indices of corners (F, 3), from 0"
    found = array(triangles, "mesh triangles", (np.shape(triangles)[0], 3), hint)
    if (found != np.round(found)).any() or found.min() < 0 or found.max() >= count:
        raise PlumblineError(
            f"mesh triangles: whole numbers from 0 to {count - 1} expected; {hint}"
        )
    return found.astype(np.int64)


def _closed(points: Array, faces: Integers) -> None:
    """Every edge must be run through as often one way as the other: no border, one sense."""
    edges = np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    sense = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    _, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    open_ones = int((np.bincount(which.reshape(-1), weights=sense) != 0).sum())
    if open_ones:
        raise PlumblineError(
            f"mesh of {len(faces)} triangles: {open_ones} edges with a triangle missing or turned "
            "over; close the surface and turn all triangles alike"
        )
    a, b, c = np.moveaxis(points[faces] - points.mean(axis=0), 1, 0)
    volume = abs(float(np.vecdot(a, np.cross(b, c)).sum())) / 6
    if volume < constants.LEAST_VOLUME:
        raise PlumblineError(
            f"mesh of volume {volume:.1e} m^3: at least {constants.LEAST_VOLUME:g} expected; give "
            "metres, and a surface around something"
        )


def _winding(points: Array, corners: Array) -> Array:
    """Winding numbers (N,) of triangles (F, 3, 3) about points (N, 3)."""
    a, b, c = np.moveaxis(corners[None] - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    top = np.vecdot(a, np.cross(b, c))
    low = la * lb * lc + np.vecdot(a, b) * lc + np.vecdot(b, c) * la + np.vecdot(c, a) * lb
    return np.arctan2(top, low).sum(axis=1) / (2 * np.pi)


Solids = Box | Cylinder | Sphere | Capsule | HalfSpace | Mesh
RESERVED = ("body", "needle", "needle path")


@dataclass(frozen=True, eq=False)
class Solid(Declared):
    """A named shape."""

    name: str  #: what answers call it, such as "aorta"
    shape: Solids  #: what it is
    margin: NotNegative | None = (
        None  #: least clearance from it [m]; None takes the one of the options
    )
    enter: bool = False  #: whether the needle may be driven through it

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name.strip() or "\n" in self.name:
            raise PlumblineError(f"solid named {self.name!r}: one line of text expected; name it")
        if self.name in RESERVED or self.name.startswith("link "):
            raise PlumblineError(f"solid named {self.name!r}: the name is taken; choose another")
        if np.isfinite(self.shape.half_size) and self.shape.half_size > constants.LARGEST:
            raise PlumblineError(
                f"{self.name}: {self.shape.half_size:g} m about its middle, at most "
                f"{constants.LARGEST:g} m; give metres, not mm"
            )

    def holds(self, point: Array) -> bool:
        """Whether a point (3,) [m], in the coordinates of the shape, lies inside."""
        if isinstance(self.shape, Mesh):
            return bool(self.shape.contains(point)[0])
        T = self.shape.placement
        body = coal.CollisionObject(self.shape.shape(), T[:3, :3], constants.MM * T[:3, 3])
        ball = coal.CollisionObject(coal.Sphere(constants.POINT), np.eye(3), constants.MM * point)
        return float(coal.distance(body, ball, coal.DistanceRequest(), coal.DistanceResult())) < 0


@dataclass(frozen=True, eq=False)
class Scene:
    """Named solids around a needle."""

    anatomy: tuple[Solid, ...] = ()  #: what the CT shows, in CT coordinates [m]
    room: tuple[Solid, ...] = ()  #: table, gantry, stands, in the robot's base frame [m]

    def __init__(self, anatomy: Iterable[Solid] = (), room: Iterable[Solid] = ()) -> None:
        """Refuse a name twice, or something that is no solid."""
        for field, given in (("anatomy", anatomy), ("room", room)):
            listed = [given] if isinstance(given, Solid) or not np.iterable(given) else given
            solids = tuple(listed)
            expect(field, solids, tuple[Solid, ...])
            object.__setattr__(self, field, solids)
        names = [solid.name for solid in (*self.anatomy, *self.room)]
        for name in names:
            if names.count(name) > 1:
                raise PlumblineError(
                    f"solid {name!r} is given {names.count(name)} times; rename it"
                )

    def __repr__(self) -> str:
        names = ", ".join(solid.name for solid in (*self.anatomy, *self.room))
        return f"<Scene of {names or 'nothing'}>"


register_kinds(Solids, *get_args(Solids))
register_kinds(Body, Box, Cylinder, Mesh)

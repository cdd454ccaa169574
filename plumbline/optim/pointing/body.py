"""Shapes about a needle: box, cylinder, sphere, capsule, and the half-space below a table.

Coal has the shapes, in millimetres (the test of two capsules compares squares with an absolute
threshold, which spoils metres), all else is in metres. A needle may have to come into a box or a
cylinder from outside: where their boundary lies along a ray is worked out here.
"""

from dataclasses import dataclass
from typing import Protocol

import coal
import numpy as np

from plumbline.declared import Declared, Point, Positive
from plumbline.errors import PlumblineError
from plumbline.kinematics.frames import homogeneous
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing.constants import LEAST_SIZE, MM, PARALLEL, ROUNDING


class Shape(Protocol):
    """What coal can tell the distance of."""

    @property
    def placement(self) -> Array:
        """Its own frame (4, 4) in the one that its coordinates are given in [m]."""

    @property
    def half_size(self) -> float:
        """Radius of the sphere about its middle that holds it [m]."""

    def shape(self) -> coal.CollisionGeometry:
        """Coal's shape about its own frame [mm]."""


class Body(Shape, Protocol):
    """What a needle must come into from outside."""

    def depth(self, point: Array, towards: Array) -> Array:
        """How far (N,) [m] a point (3,) lies inside along directions (N, 3); below 0 if outside."""


@dataclass(frozen=True)
class Box(Declared):
    """A box whose edges lie along the CT's axes."""

    lower: Point  #: its least corner (3,) [m]
    upper: Point  #: its largest corner (3,) [m]

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, a, b in zip("xyz", self.lower, self.upper, strict=True):
            if a >= b:
                raise PlumblineError(
                    f"box {name}: lower {a:g} m is not below upper {b:g} m; swap them"
                )

    @property
    def placement(self) -> Array:
        """The box's centre, axes along the CT's (4, 4) [m]."""
        return homogeneous(np.eye(3), np.add(self.lower, self.upper) / 2)

    @property
    def half_size(self) -> float:
        """Radius of the sphere about its middle that holds it [m]."""
        return float(np.linalg.norm(np.subtract(self.upper, self.lower))) / 2

    def shape(self) -> coal.CollisionGeometry:
        """Coal's box [mm]."""
        return coal.Box(MM * np.subtract(self.upper, self.lower))

    def depth(self, point: Array, towards: Array) -> Array:
        """How far (N,) [m] a point (3,) lies inside along directions (N, 3); below 0 if outside."""
        low, high = np.asarray(self.lower) - point, np.asarray(self.upper) - point
        if (low > 0).any() or (high < 0).any():
            return np.full(len(towards), -1.0)
        along = np.abs(towards) < PARALLEL
        ways = np.where(towards > 0, high, low) / np.where(along, 1.0, towards)
        return np.asarray(np.where(along, np.inf, ways).min(axis=1))


@dataclass(frozen=True)
class Cylinder(Declared):
    """A round body, such as a trunk lying along one axis."""

    centre: Point  #: its middle in CT coordinates (3,) [m]
    radius: Positive  #: [m]
    length: Positive  #: [m]
    axis: Point = (1.0, 0.0, 0.0)  #: direction of its axis in CT (3,)

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.linalg.norm(self.axis) < ROUNDING:
            raise PlumblineError("cylinder axis = 0 0 0: a direction expected; give one")

    @property
    def placement(self) -> Array:
        """Middle of the cylinder, its z along the axis (4, 4) [m]."""
        return homogeneous(turning_z_to(np.asarray(self.axis, dtype=float)), self.centre)

    @property
    def half_size(self) -> float:
        """Radius of the sphere about its middle that holds it [m]."""
        return float(np.hypot(self.radius, self.length / 2))

    def shape(self) -> coal.CollisionGeometry:
        """Coal's cylinder [mm]."""
        return coal.Cylinder(MM * self.radius, MM * self.length)

    def depth(self, point: Array, towards: Array) -> Array:
        """How far (N,) [m] a point (3,) lies inside along directions (N, 3); below 0 if outside."""
        T = self.placement
        p, d = (point - T[:3, 3]) @ T[:3, :3], towards @ T[:3, :3]
        room = self.radius**2 - p[0] ** 2 - p[1] ** 2
        if room < 0 or abs(p[2]) > self.length / 2:
            return np.full(len(towards), -1.0)
        a, b = d[:, 0] ** 2 + d[:, 1] ** 2, d[:, :2] @ p[:2]
        upright, level = a < PARALLEL**2, np.abs(d[:, 2]) < PARALLEL
        wall = (np.sqrt(b**2 + a * room) - b) / np.where(upright, 1.0, a)
        ends = (np.sign(d[:, 2]) * self.length / 2 - p[2]) / np.where(level, 1.0, d[:, 2])
        wall, ends = np.where(upright, np.inf, wall), np.where(level, np.inf, ends)
        return np.minimum(wall, ends)


def turning_z_to(direction: Array) -> Array:
    """A rotation (3, 3) that takes z to a direction (3,)."""
    x, y, z = direction / np.linalg.norm(direction)
    if z < -1.0 + ROUNDING:
        return np.diag([1.0, -1.0, -1.0])
    c = 1.0 / (1.0 + z)
    return np.array([[1 - c * x * x, -c * x * y, x], [-c * x * y, 1 - c * y * y, y], [-x, -y, z]])


@dataclass(frozen=True)
class Sphere(Declared):
    """A ball."""

    centre: Point  #: its middle (3,) [m]
    radius: Positive  #: [m]

    @property
    def placement(self) -> Array:
        """Its middle (4, 4) [m]."""
        return homogeneous(np.eye(3), self.centre)

    @property
    def half_size(self) -> float:
        """Its radius [m]."""
        return float(self.radius)

    def shape(self) -> coal.CollisionGeometry:
        """Coal's sphere [mm]."""
        return coal.Sphere(MM * self.radius)


@dataclass(frozen=True)
class Capsule(Declared):
    """All that lies within a radius of a segment: a piece of a vessel or of a long bone."""

    start: Point  #: one end of the segment (3,) [m]
    end: Point  #: the other (3,) [m]
    radius: Positive  #: [m]

    def __post_init__(self) -> None:
        super().__post_init__()
        length = float(np.linalg.norm(np.subtract(self.end, self.start)))
        if length < LEAST_SIZE:
            raise PlumblineError(
                f"capsule of length {length:g} m: more than {LEAST_SIZE:g} m expected; use Sphere"
            )

    @property
    def ends(self) -> Array:
        """Both ends (2, 3) [m]."""
        return np.array([self.start, self.end], dtype=float)

    @property
    def placement(self) -> Array:
        """Its middle, z along the segment (4, 4) [m]."""
        a, b = self.ends
        return homogeneous(turning_z_to(b - a), (a + b) / 2)

    @property
    def half_size(self) -> float:
        """Radius of the sphere about its middle that holds it [m]."""
        a, b = self.ends
        return float(np.linalg.norm(b - a) / 2 + self.radius)

    def shape(self) -> coal.CollisionGeometry:
        """Coal's capsule [mm]."""
        a, b = self.ends
        return coal.Capsule(MM * self.radius, MM * float(np.linalg.norm(b - a)))


@dataclass(frozen=True)
class HalfSpace(Declared):
    """All that lies behind a plane: a table, a floor, a wall."""

    point: Point  #: of the plane (3,) [m]
    #: direction (3,) away from what is solid; upwards unless stated
    normal: Point = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.linalg.norm(self.normal) < LEAST_SIZE:
            raise PlumblineError("half-space normal = 0 0 0: a direction expected; give one")

    @property
    def placement(self) -> Array:
        """The plane's point, z along its normal (4, 4) [m]."""
        return homogeneous(turning_z_to(np.asarray(self.normal, dtype=float)), self.point)

    @property
    def half_size(self) -> float:
        """Endless [m]."""
        return float("inf")

    def shape(self) -> coal.CollisionGeometry:
        """Coal's half-space, solid where z < 0 [mm]."""
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)

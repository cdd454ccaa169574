"""More shapes: a sphere, a capsule, and the half-space below a table.

Coal works in millimetres (see :mod:`plumbline.optim.pointing.body`), everything here in metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.pointing.body import turning_z_to
from plumbline.optim.pointing.constants import LEAST_SIZE, MM
from plumbline.optim.pointing.given import Array, array, number


@dataclass(frozen=True)
class Sphere:
    """A ball.

    Attributes:
        centre: Its middle (3,) [m].
        radius: [m].
    """

    centre: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        """Refuse a radius that is not positive."""
        array(self.centre, "sphere centre", (3,), "give its coordinates in m")
        number(self.radius, "sphere radius [m]", above=0.0)

    @property
    def placement(self) -> Array:
        """Its middle (4, 4) [m]."""
        return _at(np.asarray(self.centre, dtype=float))

    @property
    def half_size(self) -> float:
        """Its radius [m]."""
        return float(self.radius)

    def shape(self) -> coal.CollisionGeometry:
        """Coal's sphere [mm]."""
        return coal.Sphere(MM * self.radius)


@dataclass(frozen=True)
class Capsule:
    """All that lies within a radius of a segment: a piece of a vessel or of a long bone.

    Attributes:
        start: One end of the segment (3,) [m].
        end: The other (3,) [m].
        radius: [m].
    """

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        """Refuse a radius that is not positive, and ends that coincide."""
        a = array(self.start, "capsule start", (3,), "give its coordinates in m")
        b = array(self.end, "capsule end", (3,), "give its coordinates in m")
        number(self.radius, "capsule radius [m]", above=0.0)
        if np.linalg.norm(b - a) < LEAST_SIZE:
            raise PlumblineError(
                f"capsule of length {np.linalg.norm(b - a):g} m: more than {LEAST_SIZE:g} m "
                "expected; use Sphere"
            )

    @property
    def ends(self) -> Array:
        """Both ends (2, 3) [m]."""
        return np.array([self.start, self.end], dtype=float)

    @property
    def placement(self) -> Array:
        """Its middle, z along the segment (4, 4) [m]."""
        a, b = self.ends
        T = _at((a + b) / 2)
        T[:3, :3] = turning_z_to(b - a)
        return T

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
class HalfSpace:
    """All that lies behind a plane: a table, a floor, a wall.

    Attributes:
        point: Of the plane (3,) [m].
        normal: Direction (3,) away from what is solid; upwards unless stated.
    """

    point: tuple[float, float, float]
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Refuse a normal without direction."""
        array(self.point, "half-space point", (3,), "give its coordinates in m")
        normal = array(self.normal, "half-space normal", (3,), "give a direction")
        if np.linalg.norm(normal) < LEAST_SIZE:
            raise PlumblineError("half-space normal = 0 0 0: a direction expected; give one")

    @property
    def placement(self) -> Array:
        """The plane's point, z along its normal (4, 4) [m]."""
        T = _at(np.asarray(self.point, dtype=float))
        T[:3, :3] = turning_z_to(np.asarray(self.normal, dtype=float))
        return T

    @property
    def half_size(self) -> float:
        """Endless [m]."""
        return float("inf")

    def shape(self) -> coal.CollisionGeometry:
        """Coal's half-space, solid where z < 0 [mm]."""
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)


def _at(place: Array) -> Array:
    T = np.eye(4)
    T[:3, 3] = place
    return T

"""What is around a needle: organs, vessels and bones in CT, table and stands in the robot's frame.

Every solid has a name, by which answers speak of it, and says how near it may be come to. A solid
that the needle may enter still keeps the arm out, and the needle as long as it stands off.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import coal
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Array
from plumbline.optim.core.stored import register_kinds
from plumbline.optim.pointing.body import Body, Box, Capsule, Cylinder, HalfSpace, Shape, Sphere
from plumbline.optim.pointing.constants import LARGEST, MM, POINT
from plumbline.optim.pointing.given import number
from plumbline.optim.pointing.mesh import Mesh

SHAPES = (Box, Cylinder, Sphere, Capsule, HalfSpace, Mesh)
RESERVED = ("body", "needle", "needle path")


@dataclass(frozen=True, eq=False)
class Solid:
    """A named shape.

    Attributes:
        name: What answers call it, such as "aorta".
        shape: Box, Cylinder, Sphere, Capsule, HalfSpace or Mesh.
        margin: Least clearance from it [m]; None takes the one of the options.
        enter: Whether the needle may be driven through it.
    """

    name: str
    shape: Shape
    margin: float | None = None
    enter: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip() or "\n" in self.name:
            raise PlumblineError(f"solid named {self.name!r}: one line of text expected; name it")
        if self.name in RESERVED or self.name.startswith("link "):
            raise PlumblineError(f"solid named {self.name!r}: the name is taken; choose another")
        if not isinstance(self.shape, SHAPES):
            known = ", ".join(shape.__name__ for shape in SHAPES)
            raise PlumblineError(
                f"{self.name}: shape {type(self.shape).__name__}, one of {known} expected"
            )
        if np.isfinite(self.shape.half_size) and self.shape.half_size > LARGEST:
            raise PlumblineError(
                f"{self.name}: {self.shape.half_size:g} m about its middle, at most {LARGEST:g} m; "
                "give metres, not mm"
            )
        if self.margin is not None and number(self.margin, f"{self.name}: margin [m]") < 0.0:
            raise PlumblineError(f"{self.name}: margin = {self.margin:g} m: at least 0 expected")

    def holds(self, point: Array) -> bool:
        """Whether a point (3,) [m], in the coordinates of the shape, lies inside."""
        if isinstance(self.shape, Mesh):
            return bool(self.shape.contains(point)[0])
        T = self.shape.placement
        body = coal.CollisionObject(self.shape.shape(), T[:3, :3], MM * T[:3, 3])
        ball = coal.CollisionObject(coal.Sphere(POINT), np.eye(3), MM * point)
        return float(coal.distance(body, ball, coal.DistanceRequest(), coal.DistanceResult())) < 0


@dataclass(frozen=True, eq=False)
class Scene:
    """Named solids around a needle.

    Attributes:
        anatomy: What the CT shows, in CT coordinates [m].
        room: Table, gantry, stands, in the robot's base frame [m].
    """

    anatomy: tuple[Solid, ...] = ()
    room: tuple[Solid, ...] = ()

    def __init__(self, anatomy: Iterable[Solid] = (), room: Iterable[Solid] = ()) -> None:
        """Check that names are told apart.

        Raises:
            PlumblineError: A name twice, or something that is no solid.
        """
        for field, given in (("anatomy", anatomy), ("room", room)):
            listed = [given] if isinstance(given, Solid) or not np.iterable(given) else given
            solids = tuple(listed)
            for solid in solids:
                if not isinstance(solid, Solid):
                    raise PlumblineError(
                        f"{field}: {type(solid).__name__} found, Solid(name, shape) expected"
                    )
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


register_kinds(Shape, *SHAPES)
register_kinds(Body, Box, Cylinder, Mesh)

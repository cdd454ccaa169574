r"""A plane that is none: bent or bulged, a polynomial over its face.

.. math:: d \leftarrow d - \frac{h(x, y)}{\cos\theta}, \qquad
          h = \sum_{2 \le i + j \le D} c_{ij} \left(\frac{x}{a}\right)^i \left(\frac{y}{a}\right)^j

with (x, y) the place on the plane and a its half width; shift and tilt are the plane's own pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs

from plumbline.kinematics.effects.effect import RANGES, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter

HEIGHT = Parameter("m", -0.05, 0.05, scale=2e-4, doc="{}")
DEGREES = (2, 4)
POWERS = tuple((n - j, j) for n in range(2, DEGREES[-1] + 1) for j in range(n + 1))


@dataclass(frozen=True)
class PlaneUnflatness(Effect):
    """Plane ``plane`` stands out of its plane by a polynomial of degree ``degree``."""

    plane: int = 1
    degree: int = 2
    half: float = field(default=0.1, metadata={"unit": "m"})

    name = "plane_unflatness"
    stage = Stage.SENSOR
    depends_on = "place"
    observations = RANGES
    words = "plane {element} is not flat"
    reference = "ISO 12781-1 (2011), sec. 3 (deviations from flatness)"
    source = "by hand: workshop boards are flat to 0.05 to 0.5 mm; the bound is no board any more"

    x2, xy, y2 = HEIGHT.each(
        *(f"height at the rim, {way}" for way in ("bent in x", "twisted", "bent in y"))
    )
    x3, x2y, xy2, y3 = HEIGHT.each(*["term of third order"] * 4)
    x4, x3y, x2y2, xy3, y4 = HEIGHT.each(*["term of fourth order"] * 5)

    @property
    def variant(self) -> str:
        """Its degree."""
        return f"degree {self.degree}"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The terms of its degree and below."""
        return self.declared[: sum(i + j <= self.degree for i, j in POWERS)]

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every plane, of either degree."""
        halves = [scope.span[f"plane{k}"][1] for k in range(1, scope.elements + 1)]
        return [cls(k, n, a) for k, a in enumerate(halves, start=1) for n in DEGREES]

    def apply(self, state: State, *values: cs.SX) -> State:
        x, y = state.spot[0] / self.half, state.spot[1] / self.half
        height = sum(c * x**i * y**j for c, (i, j) in zip(values, POWERS, strict=False))
        here = state.row["element"] == self.plane
        return replace(state, reading=state.reading - here * height / state.normal[2])

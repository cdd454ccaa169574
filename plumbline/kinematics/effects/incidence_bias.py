r"""A slanted beam reads long or short, with the slope that it meets or with the square of it.

.. math:: d \leftarrow d + k\,|u| \quad\text{or}\quad d \leftarrow d + u^T K u, \qquad
          u = (n_x, n_y) / n_z

with n the plane's normal in the beam's frame, so that :math:`|u| = \tan\theta`: a spot's near edge
is read first, or its light is averaged. Where the beam widens with the range, either grows in
proportion to d as well. K is one number times the identity, or symmetric, as a
finder looks along its baseline otherwise than across it. What grows with :math:`1 / \cos\theta - 1`
or with u itself is as if beam and planes stood elsewhere, and no recording of planes can show it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.effects.effect import RANGES, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter

SHARP = 1e-6  # slope within which the tip of |u| is rounded: it has a derivative everywhere


@dataclass(frozen=True)
class IncidenceBias(Effect):
    """A bias that grows with the slope, or with its square, alike to all sides or not."""

    squared: bool = True
    alike: bool = True
    widening: bool = False

    name = "incidence_bias"
    stage = Stage.SENSOR
    depends_on = "incidence"
    observations = RANGES
    words = "slanted beams read long or short"
    reference = "Soudarissanane et al. (2011), ISPRS J. Photogramm. Remote Sens. 66(4), sec. 3"
    source = (
        "by hand: some per cent of a spot of 1 to 3 mm that spreads over a slanted face; the bound "
        "is several spots"
    )
    xx = Parameter("m", -0.02, 0.02, scale=1e-4, doc="at 45 deg, about the beam's y")
    yy = Parameter("m", -0.02, 0.02, scale=1e-4, doc="at 45 deg, about the beam's x")
    xy = Parameter("m", -0.02, 0.02, scale=1e-4, doc="at 45 deg, the mixed part")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """One number where all sides are alike."""
        if self.alike:
            return (replace(self.declared[0], doc=f"at 45 deg{' and 1 m' * self.widening}"),)
        return self.declared

    @property
    def variant(self) -> str:
        """With what it grows, and whether its sides are alike."""
        grows = "with the square of the slope" if self.squared else "with the slope"
        grows += " and the range" if self.widening else ""
        return grows if self.alike else f"{grows}, not alike to all sides"

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """With the slope, or its square, of a beam that widens or not; not alike to all sides."""
        either = (False, True)
        alike = [cls(squared, True, widens) for squared in either for widens in either]
        return [*alike, cls(alike=False)]

    def apply(self, state: State, *values: cs.SX) -> State:
        x, y = state.normal[0] / state.normal[2], state.normal[1] / state.normal[2]
        xx, yy, xy = (values[0], values[0], 0.0) if self.alike else values
        bias = xx * x**2 + yy * y**2 + 2 * xy * x * y
        if not self.squared:
            bias = values[0] * (cs.sqrt(x**2 + y**2 + SHARP**2) - SHARP)
        far = state.reading if self.widening else 1.0
        return replace(state, reading=state.reading + far * bias)

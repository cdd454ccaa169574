r"""A slender tool bends under its own weight: :math:`\delta = s\, (\hat g - u\, u^T \hat g)`.

u is the tool's axis, s the sag of the tip when the tool lies level; for a uniform rod of weight w
per length s = w L^4 / (8 E I) (Timoshenko 1955, Strength of Materials I, sec. 21). An axis that is
a little off, :math:`u + \epsilon` with :math:`\epsilon \perp u`, adds to first order
:math:`-(u\, a^T + a\, u^T)\, \hat g` with :math:`a = s\, \epsilon`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.constants import TIP_TO_AXIS
from plumbline.kinematics.effects.effect import TOOL_OBSERVATIONS, Effect, Scope, Stage, State
from plumbline.kinematics.frames import constant
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class NeedleSag(Effect):
    """Bending of the tool under gravity, along its axis from the tip frame or one on a bracket."""

    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    askew: bool = False

    name = "needle_sag"
    stage = Stage.TOOL
    observations = TOOL_OBSERVATIONS
    depends_on = "load"
    needs_gravity = True
    words = "the needle or tool bends under its own weight"
    reference = "Timoshenko (1955), Strength of Materials I, sec. 21"
    source = (
        "w L^4 / (8 E I) of steel needles, 1 to 2 mm thick and 150 to 300 mm long; the bound by "
        "hand"
    )
    sag = Parameter("m", 0.0, 0.02, scale=3e-4, doc="sag of the tip when the tool lies level")
    lean_1 = Parameter("m", -2e-3, 2e-3, scale=2e-5, doc="sag times the axis's error one way")
    lean_2 = Parameter("m", -2e-3, 2e-3, scale=2e-5, doc="sag times the axis's error the other way")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The sag alone where the axis is taken as it is drawn."""
        return self.declared if self.askew else self.declared[:1]

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Along the nominal tool, or a little off; on a bracket along an axis of the tip frame."""
        along = axis_of(scope)
        mounted = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
        return [cls(along, askew=True), *(cls(u) for u in dict.fromkeys([along, *mounted]))]

    def apply(self, state: State, *values: cs.SX) -> State:
        R_tip_base = state.nominal.frames[-1].R.T
        down = R_tip_base @ state.gravity_direction()
        u = constant(self.axis)
        shift = values[0] * (down - u * cs.dot(u, down))
        for lean, side in zip(values[1:], sides(self.axis), strict=False):
            shift -= lean * (u * cs.dot(side, down) + side * cs.dot(u, down))
        return replace(state, tool=state.tool + shift)


def axis_of(scope: Scope) -> tuple[float, float, float]:
    """Unit vector from the tip frame to the nominal tip, or z where the tool has no length."""
    length = float(np.linalg.norm(scope.tool))
    unit = scope.tool / length if length > TIP_TO_AXIS else np.array([0.0, 0.0, 1.0])
    return (float(unit[0]), float(unit[1]), float(unit[2]))


def sides(axis: tuple[float, float, float]) -> list[cs.SX]:
    """Two unit vectors square to an axis and to each other."""
    _, _, rows = np.linalg.svd(np.array([axis]))
    return [constant(rows[1]), constant(rows[2])]

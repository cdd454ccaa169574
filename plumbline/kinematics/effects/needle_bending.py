r"""A slender tool bends under a recorded force on its tip: :math:`\delta = c\, (F - u\, u^T F)`.

u is the tool's axis and F the force on the tip, both in the tip frame, less to first order
:math:`(u\, a^T + a\, u^T)\, F` with :math:`a = c\, \epsilon` where the axis is a little off,
:math:`u + \epsilon` with :math:`\epsilon \perp u`; of a uniform rod of length L
:math:`c = L^3 / (3 E I)`, and its tip turns by :math:`\tfrac{3 c}{2 L}\, u \times F` (Timoshenko
1955, Strength of Materials I, sec. 20).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects.effect import (
    TOOL_OBSERVATIONS,
    UNSAID,
    Effect,
    Scope,
    Stage,
    State,
)
from plumbline.kinematics.effects.needle_sag import axis_of, sides
from plumbline.kinematics.frames import constant, rotation
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class NeedleBending(Effect):
    """Bending of the tool under a force on its tip; its axis runs from the tip frame to the tip."""

    axis: tuple[float, float, float] = field(default=(0.0, 0.0, 1.0), metadata=UNSAID)
    length: float = field(default=0.0, metadata=UNSAID)
    askew: bool = False

    name = "needle_bending"
    depends_on = "load"
    stage = Stage.TOOL
    observations = TOOL_OBSERVATIONS
    needs = ("force",)
    words = "the needle or tool bends under the force on its tip"
    reference = "Timoshenko (1955), Strength of Materials I, sec. 20"
    source = (
        "L^3 / (3 E I) of steel needles 1 to 2 mm thick and 100 to 200 mm long, 0.1 to 40 mm/N, "
        "and of stiffer tools; the bound is a soft catheter's, by hand"
    )
    compliance = Parameter("m/N", 0.0, 1.0, scale=1e-3, doc="tip's shift per force")
    lean_1, lean_2 = Parameter(
        "m/N", -0.1, 0.1, scale=6e-5, doc="shift per force times the axis's error {} way"
    ).each("one", "the other")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The shift alone where the axis is taken as it is drawn."""
        return self.declared if self.askew else self.declared[:1]

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """One, along the nominal tool, or along z where the tool has no length."""
        return [cls(axis_of(scope), float(np.linalg.norm(scope.tool)))]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """The same with an axis that is a little off."""
        return [] if self.askew else [replace(self, askew=True)]

    def apply(self, state: State, *values: cs.SX) -> State:
        u, force = constant(self.axis), state.row["force"]
        bent = values[0] * (force - u * cs.dot(u, force))
        for lean, side in zip(values[1:], sides(self.axis), strict=False):
            bent -= lean * (u * cs.dot(side, force) + side * cs.dot(u, force))
        if not self.length:
            return replace(state, tool=state.tool + bent)
        turn = rotation(1.5 / self.length * cs.cross(u, bent))
        return replace(state, tool=state.tool + bent, R_tip_tool=turn @ state.R_tip_tool)

r"""The tool's tip is not where the drawing has it: :math:`p \leftarrow p + \delta p`."""

from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.effects.effect import TOOL_OBSERVATIONS, Effect, Stage, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ToolOffset(Effect):
    """A wrong tool offset, for recordings in which the tool is not always fitted."""

    name = "tool_offset"
    stage = Stage.TOOL
    observations = TOOL_OBSERVATIONS
    depends_on = "nothing"
    words = "the tool's tip is not where the model has it"
    reference = "Mooring, Roth, Driels (1991), Fundamentals of Manipulator Calibration, ch. 2"
    source = "by hand: a tool measured with a ruler; the bound is another tool"
    x, y, z = Parameter("m", -0.1, 0.1, scale=1e-3, doc="along the tip frame's {}").each(*"xyz")

    def apply(self, state: State, *values: cs.SX) -> State:
        return replace(state, tool=state.tool + cs.vertcat(*values))

r"""CT's voxels are not as large as its header says: :math:`c \leftarrow (1 + k)\, c`.

In all directions alike, or along one axis alone, as where the table's feed or the slices' spacing
is wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.effects.effect import FIDUCIALS, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class CtScale(Effect):
    """A scale error of CT, alike or along axis ``axis`` (1, 2, 3; 0: all)."""

    axis: int = 0

    name = "ct_scale"
    stage = Stage.REGISTRATION
    depends_on = "place"
    acts_at = Stage.JOINT
    observations = FIDUCIALS
    words = "CT's scale is off"
    reference = "Hill et al. (1998), J. Comput. Assist. Tomogr. 22(2) (scaling errors in tomograms)"
    source = (
        "by hand: a table's feed that is off by a millimetre over a head, 0.3 %; the bound is a "
        "wrong header"
    )
    scale = Parameter("1", -0.1, 0.1, scale=3e-3, doc="relative error of lengths")

    @property
    def variant(self) -> str:
        """Along which axis."""
        return f"along CT's {'xyz'[self.axis - 1]}" if self.axis else ""

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """All axes alike, or each alone."""
        return [cls(axis) for axis in range(4)]

    def apply(self, state: State, *values: cs.SX) -> State:
        factors = [values[0] if self.axis in (0, k) else cs.SX(0) for k in (1, 2, 3)]
        return replace(state, q=state.q * (1 + cs.vertcat(*factors)))

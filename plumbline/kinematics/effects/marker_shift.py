r"""One marker is not where the CT saw it: :math:`c_k \leftarrow c_k + \delta`, in CT's frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.effects.effect import FIDUCIALS, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class MarkerShift(Effect):
    """Marker ``marker`` has moved between the CT and the robot's touch."""

    marker: int = 1

    name = "marker_shift"
    stage = Stage.REGISTRATION
    depends_on = "marker"
    acts_at = Stage.JOINT
    observations = FIDUCIALS
    words = "marker {element} has moved since the CT was taken"
    reference = "Fitzpatrick, West, Maurer (1998), IEEE Trans. Med. Imaging 17(5), sec. II"
    source = "by hand: markers on skin shift by millimetres; the bound is another marker"
    x, y, z = Parameter("m", -0.03, 0.03, scale=1e-3, doc="shift along CT's {}").each(*"xyz")

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every marker."""
        return [cls(k) for k in range(1, scope.elements + 1)]

    def apply(self, state: State, *values: cs.SX) -> State:
        here = state.row["element"] == self.marker
        return replace(state, q=state.q + here * cs.vertcat(*values))

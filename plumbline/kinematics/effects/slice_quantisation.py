r"""CT's slices are thick: every marker's place across them is rounded to a multiple of the pitch h.

.. math:: c_k \leftarrow c_k + \epsilon_k\, e_a, \qquad
          \epsilon_k \sim U(-h/2,\ h/2), \quad \mathrm{std}\ h / \sqrt{12}

An error a marker, the same whenever it is touched. The axis and the pitch are those of
``ct_resolution``, or of the grid on which the coordinates lie.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects.effect import FIDUCIALS, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class SliceQuantisation(Effect):
    """Rounding along axis ``axis`` (0, 1, 2 of CT) of each of so many markers."""

    axis: int = 2
    pitch: float = field(default=1e-3, metadata={"unit": "m"})
    markers: int = 4

    name = "slice_quantisation"
    stage = Stage.REGISTRATION
    depends_on = "marker"
    acts_at = Stage.JOINT
    observations = FIDUCIALS
    words = "places in CT are rounded to its slices"
    reference = "Bennett (1948), Bell Syst. Tech. J. 27(3), sec. 2 (quantisation noise)"
    source = (
        "h / sqrt(12) of a pitch of 0.6 to 5 mm; the bound is one pitch, twice what rounding does"
    )
    offset = Parameter("m", -5e-3, 5e-3, scale=3e-4, doc="what rounding took away")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """One a marker, as wide as the pitch says."""
        h, one = self.pitch, self.declared[0]
        wide = replace(one, lower=-h, upper=h, scale=h / float(np.sqrt(12.0)))
        return tuple(
            replace(wide, name=f"marker {k}", doc=f"{one.doc} of marker {k}")
            for k in range(1, self.markers + 1)
        )

    @property
    def variant(self) -> str:
        """Along which axis, in which steps."""
        return f"along CT's {'xyz'[self.axis]}, in steps of {1e3 * self.pitch:.3g} mm"

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every axis of which a pitch is known."""
        pitches = {a: scope.span.get(f"pitch{a}", (0.0, 0.0))[1] for a in range(3)}
        return [cls(a, h, scope.elements) for a, h in pitches.items() if h > 0.0]

    @classmethod
    def out_of_reach(cls, scope: Scope) -> str:
        """No pitch is stated or seen."""
        return "no ct_resolution is stated, and the places in CT lie on no grid"

    def apply(self, state: State, *values: cs.SX) -> State:
        part, q = state.row["element"], cs.SX(state.q)
        q[self.axis] += sum((part == k) * v for k, v in enumerate(values, start=1))
        return replace(state, q=q)

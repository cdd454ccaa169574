r"""One link is not as long, as offset or as twisted as the drawing says.

.. math:: T_{i,i+1} \leftarrow T_z(\delta d)\, [T_{i,i+1}]\,
          T_x(\delta a)\, R_x(\delta\alpha)\, R_y(\delta\beta)

in the link's Denavit-Hartenberg frame. Where two axes are parallel the common normal jumps at the
slightest tilt, so beta is added there (Hayati and Mirmirani 1985, eq. 5).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as cs

from plumbline.kinematics.chain import nearly_parallel
from plumbline.kinematics.effects.effect import Effect, Scope, Stage, State
from plumbline.kinematics.frames import Transform, constant
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class LinkGeometry(Effect):
    """Wrong d, a, alpha (and, between parallel axes, beta) of one link."""

    link: int = 1
    parallel: bool = False

    name = "link_geometry"
    stage = Stage.LINK
    depends_on = "nothing"
    words = "link {element} is not as long or as twisted as the model says"
    reference = "Hayati and Mirmirani (1985), J. Robotic Systems 2(4), eq. 5"
    source = (
        "by hand: castings and shims, half a millimetre and a milliradian; the bounds are another "
        "arm"
    )
    d = Parameter("m", -0.05, 0.05, scale=5e-4, doc="offset along the joint's axis")
    # As the robot's DH row counts them; where it has none the normal points from axis to axis.
    a = Parameter("m", -0.05, 0.05, scale=5e-4, doc="shift along the common normal")
    alpha = Parameter("rad", -0.1, 0.1, scale=1e-3, doc="twist about the common normal")
    beta = Parameter("rad", -0.1, 0.1, scale=1e-3, doc="tilt of parallel axes")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Beta only where the axes are parallel: elsewhere it repeats the joint's offset."""
        return self.declared if self.parallel else self.declared[:3]

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every link but the last, which frame and tool absorb as far as a point can tell."""
        pairs = enumerate(pairwise(scope.chain.joints), start=1)
        return [cls(link=i, parallel=nearly_parallel(*pair)) for i, pair in pairs]

    def apply(self, state: State, *values: cs.SX) -> State:
        d, a, alpha, beta = (*values, cs.SX(0))[:4]
        zero = cs.SX(0)
        frame = Transform.from_matrix(state.chain.link_frames()[self.link - 1])
        slide = Transform(cs.SX.eye(3), constant(state.chain.joints[self.link - 1].axis) * d)
        along = Transform.from_twist(cs.vertcat(a, zero, zero), cs.vertcat(alpha, zero, zero))
        tilt = Transform.from_twist(cs.SX(3, 1), cs.vertcat(zero, beta, zero))
        change = slide @ frame @ along @ tilt @ frame.inverse()
        return state.place_link(self.link, change @ state.placements[self.link])

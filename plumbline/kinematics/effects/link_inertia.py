r"""A link whose mass, or whose centre of mass, is not the model's.

.. math:: m \leftarrow m_0\,(1 + s), \quad m c \leftarrow m_0\,(c_0\,(1 + s) + d), \quad
          J \leftarrow J_c\,(1 + s) + m\,(c^T c\, I - c\, c^T)

about the joint's origin (Steiner), with the body's own shape as modelled; the shift d is told at
the modelled mass, in which gravity's torque is linear. Of most links a motion
shows but a part of this: what turns about one upright axis shows no weight at all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.dynamics import steiner
from plumbline.kinematics.effects.drive import TORQUES
from plumbline.kinematics.effects.effect import UNSAID, Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter

LEAST_MASS = 1e-3  # kg: what weighs less has no centre worth moving
LEAST_REACH = 0.01  # m: no arm is shorter; of one joint bodies alone say how far it reaches


@dataclass(frozen=True)
class LinkInertia(Effect):
    """Mass and centre of link ``link`` (from 1), which its joint moves.

    The centre's shift is declared for an arm that reaches one metre, ``reach`` [m].
    """

    link: int = 1
    reach: float = field(default=1.0, metadata=UNSAID)

    depends_on = "load"
    name = "link_inertia"
    stage = Stage.ACTUATION
    acts_at = Stage.LINK
    observations = TORQUES
    words = "link {element} weighs more or less than modelled, or has its centre elsewhere"
    reference = "Atkeson, An, Hollerbach (1986), Int. J. Robotics Research 5(3), sec. 2"
    source = (
        "by hand: a tenth of what a maker's model says, its centre to a fiftieth of the reach; the "
        "bounds are another body"
    )
    mass = Parameter("1", -0.9, 4.0, scale=0.1, doc="mass more than modelled, as a share of it")
    x, y, z = Parameter(
        "m", -0.5, 0.5, scale=0.02, doc="shift of its centre along {} of its joint"
    ).each(*"xyz")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The shift as wide as the arm is long."""
        mass, *shift = self.declared
        return (mass, *(along.of_width(self.reach) for along in shift))

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every link that has a mass."""
        bodies, (_, reach) = enumerate(scope.chain.joints, start=1), size_of(scope.chain)
        return [cls(i, reach) for i, body in bodies if body.mass > LEAST_MASS]

    def apply(self, state: State, *values: cs.SX) -> State:
        own = state.inertial[self.link - 1, :].T
        more, shift = 1 + values[0], cs.vertcat(*values[1:])
        mass = own[0] * more
        centre = own[1:4] / own[0] + shift / more
        about_centre = own[4:] - steiner(own[0], own[1:4] / own[0])
        inertia = about_centre * more + steiner(mass, centre)
        inertial = cs.SX(state.inertial)
        inertial[self.link - 1, :] = cs.vertcat(mass, mass * centre, inertia).T
        return replace(state, inertial=inertial)


def size_of(chain: Chain) -> tuple[float, float]:
    """What the bodies of an arm weigh [kg], and how far it reaches [m], to two digits."""
    mass = sum(body.mass for body in chain.joints)
    reach = max(chain.reach, LEAST_REACH, *(float(np.linalg.norm(b.com)) for b in chain.joints))
    return float(f"{max(mass, LEAST_MASS):.2g}"), float(f"{reach:.2g}")

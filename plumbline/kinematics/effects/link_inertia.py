r"""A link whose mass, or whose centre of mass, is not the model's.

.. math:: m \leftarrow m_0\,(1 + s), \quad m c \leftarrow m_0\,(c_0\,(1 + s) + d), \quad
          J \leftarrow J_c\,(1 + s) + m\,(c^T c\, I - c\, c^T)

about the joint's origin (Steiner), with the body's own shape as modelled; the shift d is told at
the modelled mass, in which gravity's torque is linear. Of most links a motion
shows but a part of this: what turns about one upright axis shows no weight at all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs

from plumbline.kinematics.effects.drive import TORQUES
from plumbline.kinematics.effects.effect import Effect, Scope, Stage, State
from plumbline.kinematics.parameters import Parameter

LEAST_MASS = 1e-3  # kg: what weighs less has no centre worth moving


@dataclass(frozen=True)
class LinkInertia(Effect):
    """Mass and centre of link ``link`` (from 1), which its joint moves."""

    link: int = 1

    depends_on = "load"
    name = "link_inertia"
    stage = Stage.ACTUATION
    acts_at = Stage.LINK
    observations = TORQUES
    words = "link {element} weighs more or less than modelled, or has its centre elsewhere"
    reference = "Atkeson, An, Hollerbach (1986), Int. J. Robotics Research 5(3), sec. 2"
    source = "by hand: a tenth of what a maker's model says; the bounds are another body"
    mass = Parameter("1", -0.9, 4.0, scale=0.1, doc="mass more than modelled, as a share of it")
    x, y, z = Parameter(
        "m", -0.5, 0.5, scale=0.02, doc="shift of its centre along {} of its joint"
    ).each(*"xyz")

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every link that has a mass."""
        bodies = enumerate(scope.chain.joints, start=1)
        return [cls(link=i) for i, body in bodies if body.mass > LEAST_MASS]

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


def steiner(mass: cs.SX, centre: cs.SX) -> cs.SX:
    """Inertia (6,) xx, xy, yy, xz, yz, zz about the origin of a point mass at ``centre`` (3,)."""
    x, y, z = cs.vertsplit(centre)
    each = (y**2 + z**2, -x * y, x**2 + z**2, -x * z, -y * z, x**2 + y**2)
    return mass * cs.vertcat(*each)

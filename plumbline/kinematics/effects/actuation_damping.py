r"""Viscous friction of a joint that is driven by torques: :math:`I \ddot y = c - h - d \dot y`."""

from dataclasses import dataclass

import casadi as cs

from plumbline.kinematics.drive import Drive, Law
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.parameters import Parameter


@dataclass(frozen=True)
class ActuationDamping(MotionEffect):
    """Grease that takes a share of the torque, in proportion to the speed."""

    name = "actuation_damping"
    depends_on = "velocity"
    words = "joint {element} works against friction that grows with its speed"
    reference = "Siciliano et al. (2009), Robotics, sec. 7.2 (viscous friction at the joints)"
    source = "by hand: as of viscous_friction, as much as dry friction at 1 rad/s"
    laws = (Law.TORQUE, Law.SAMPLED_TORQUE)
    damping = Parameter("N m s/rad", 0.0, 10.0, scale=0.1, doc="friction at 1 rad/s, per that")

    def apply(self, drive: Drive, value: cs.SX) -> Drive:
        return drive.changed(damping=value)

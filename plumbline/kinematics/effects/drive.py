r"""What all effects on a drive's torque have in common: one joint, and sizes in its usual load.

.. math:: \tau_i \leftarrow \tau_i + \Delta\tau_i(q_i, \dot q_i, \ddot q_i), \qquad
          |\Delta\tau_i| \sim \text{scale} \cdot L_i

A hobby servo and a palletiser differ by four decades in torque, hardly in the share that friction
takes of it. So widths and bounds are declared for a joint of one newton metre and grow with
:math:`L_i`, half of the largest effort that the recording holds of the joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

from plumbline.kinematics.effects.effect import JointEffect, Scope, Stage
from plumbline.kinematics.parameters import Parameter

TORQUES = ("joint_torque",)
LEAST_LOAD = 1e-3  # N m: less than a hobby servo's current resolves


@dataclass(frozen=True)
class DriveEffect(JointEffect):
    """An effect on the torque of one joint's drive, whose usual load is ``load`` [N m or N]."""

    load: float = field(default=1.0, metadata={"unit": "N m"})

    stage = Stage.ACTUATION
    observations = TORQUES
    in_load: ClassVar[bool] = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """As declared, times the joint's usual load where they are torques."""
        by = self.load if self.in_load else 1.0
        return tuple(
            replace(p, lower=p.lower * by, upper=p.upper * by, scale=p.scale * by)
            for p in self.declared
        )

    @property
    def variant(self) -> str:
        """Nothing: a joint has one drive."""
        return ""

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Self]:
        """One variant a joint."""
        return [cls(joint=j, load=usual_load(scope, j)) for j in scope.joints]


def usual_load(scope: Scope, joint: int) -> float:
    """Half of the largest effort measured of a joint (from 1), to two digits [N m or N]."""
    low, high = scope.span.get(f"effort{joint}", (-2.0, 2.0))
    return float(f"{max(0.5 * max(abs(low), abs(high)), LEAST_LOAD):.2g}")


def largest_speed(scope: Scope, joint: int) -> float:
    """The largest speed of a joint (from 1) [rad/s or m/s]."""
    return max(map(abs, scope.span.get(f"velocity{joint}", (1.0, 1.0))))

r"""A joint's bearing gives way across its axis, under the moment of what it carries.

.. math:: T_{i,i+1} \leftarrow \exp(0,\ c_i\, (M_i - u_i\, u_i^T M_i))\, T_{i,i+1}, \qquad
          M_i = \sum_{k \ge i} (p_k - o_i) \times m_k\, g

with the axis :math:`u_i` through :math:`o_i`, and the centres :math:`p_k` of all bodies from the
joint outwards and of the payload; under a tool of unknown mass also that of a kilogram at the
tool's middle, by a number of its own, and bodies that do not weigh what the model says count by
their own shares (:mod:`plumbline.kinematics.weights`). A housing may be softer about one
direction than about another, by a little: then :math:`c_i` is a symmetric tensor in the housing,
which does not turn with the joint: a sum of three, softest a third of a half turn apart, none of
them negative. (Were one direction soft alone, it would be the drive before it that gives way.)
The moment about the axis is the drive's (``joint_compliance``). A first joint that stands upright
tilts exactly as its mounting does: that is ``base_compliance``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.dynamics import weight_beyond
from plumbline.kinematics.effects.effect import (
    TIP_OBSERVATIONS,
    UNSAID,
    Effect,
    JointEffect,
    Scope,
    Stage,
    State,
)
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.frames import Transform, axis_rotation, constant
from plumbline.kinematics.parameters import Parameter
from plumbline.kinematics.weights import (
    CARRIED,
    LADEN,
    REWEIGHED,
    Bodies,
    bodies_beyond,
    shares,
    with_shares,
)

SOFTER = 0.3  # most by which a housing is softer about one direction [its mean]; by hand
UPRIGHT = 1e-3  # sine of the angle to gravity below which an axis stands upright


@dataclass(frozen=True)
class JointTilt(JointEffect):
    """Tilt of one bearing across its axis, alike about all directions or as its housing has it."""

    laden: bool = False
    alike: bool = True
    load: float = field(default=100.0, metadata=UNSAID)
    bodies: Bodies = field(default=(), metadata=UNSAID)
    found: tuple[float, ...] = field(default=(), metadata=UNSAID)

    name = "joint_tilt"
    depends_on = "load"
    acts_at = Stage.LINK
    needs_gravity = True
    observations = TIP_OBSERVATIONS
    words = "joint {element}'s bearing gives way across its axis under its load"
    reference = "Abele, Rothenbuecher, Weigold (2008), Production Engineering 2(3), sec. 3"
    source = (
        "makers' moment stiffnesses of the cross roller bearings in gear units, 5e4 to 1e6 N "
        "m/rad, some ten times the torsional one of the same unit; the bound is a worn bush's, by "
        "hand"
    )
    compliance = Parameter(
        "rad/(N m)", 0.0, 1e-2, scale=1e-6, doc="tilt per moment across the axis"
    )
    carried = CARRIED.of_width(0.2)
    second, third = Parameter(
        "rad/(N m)", 0.0, 1e-2, scale=1e-6, doc="the same, softest {} of a half turn further on"
    ).each("a third", "two thirds")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """In units of what bearings of this load have: they are made for their load."""
        found = (self.compliance, self.carried)[: 1 + self.laden]
        found = found if self.alike else (self.compliance, self.second, self.third)
        own = tuple(p.of_width(100.0 / self.load) for p in found)
        about = sum(self.found[: 1 if self.alike else 3])
        return with_shares(own, self.found, about, self.bodies)

    @property
    def variant(self) -> str:
        """Whether it carries a tool that the model does not know of, or its housing is uneven."""
        found = LADEN * self.laden + ", not alike" * (not self.alike)
        return (found + REWEIGHED * bool(self.bodies))[2:]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """The same bearing under a tool of unknown mass, or in an uneven housing."""
        if self.laden or self.bodies or not self.alike:
            return []
        return [replace(self, laden=True), replace(self, alike=False)]

    def deviations(self, scope: Scope, values: Sequence[float]) -> Sequence[Effect]:
        """The same bearing, in any housing, under bodies of other weights."""
        bodies = bodies_beyond(scope.chain, self.joint)
        if not bodies or not values[0] + (not self.alike) * sum(values) > 0.0:
            return []
        own = replace(self, bodies=bodies, found=tuple(values))
        uneven = replace(own, laden=False, alike=False, found=(values[0] / 3,) * 3)
        return [own, uneven] if self.alike else [own]

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every joint that turns and carries a weight, but a first one that stands upright.

        The moment on another one turns with its link, which an even housing leaves bent for good:
        what moves is all of an uneven one, which is asked too.
        """
        chain, all_laden = scope.chain, scope.has("payload")
        laden = [j for j in scope.turning if all_laden or _carries(chain, j)]
        found = [cls(j, load=chain.typical_load(j)) for j in laden if not upright(chain, j)]
        return [*found, *(replace(e, alike=False) for e in found if _stands(chain, e.joint))]

    def unit_of(self, parameter: Parameter, chain: Chain) -> str:
        """A tilt per moment, whatever the joint does along its axis."""
        return parameter.unit

    def apply(self, state: State, *values: cs.SX) -> State:
        frame = state.nominal.frames[self.joint - 1]
        of_bodies = values[len(values) - len(self.bodies) :]
        weights = shares(state.chain, self.bodies, of_bodies, values[0] if self.alike else 0.0)
        _, moment = weight_beyond(state.nominal, self.joint, frame.t, weights)
        if self.laden:
            lever = state.middle - frame.t
            moment += values[1] * cs.cross(lever, constant(state.chain.gravity))
        own, axis = frame.R.T @ moment, state.chain.joints[self.joint - 1].axis
        turn = own - constant(axis) * cs.dot(constant(axis), own)
        if not self.alike:
            _, whole = weight_beyond(state.nominal, self.joint, frame.t)
            R, E = axis_rotation(axis, state.nominal.q[self.joint - 1]), constant(across(axis))
            turn += R.T @ E @ _softness(values[:3]) @ E.T @ R @ frame.R.T @ whole
        tilt = Transform.from_twist(cs.SX(3, 1), turn)
        return state.place_link(self.joint, tilt @ state.placements[self.joint])


def _softness(values: Sequence[cs.SX]) -> cs.SX:
    """The tensor (2, 2) across the axis: none of its directions is far softer than another."""
    found = cs.SX(2, 2)
    for k, value in enumerate(values):
        c, s = np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3)
        found += value * constant(np.eye(2) + SOFTER * np.array([[c, s], [s, -c]]))
    return found


def across(axis: Array) -> Array:
    """Two unit directions (3, 2) across an axis: that of the least of its components first."""
    first = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = first - axis * (axis @ first)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=1)


def _carries(chain: Chain, joint: int) -> bool:
    return any(body.mass > 0.0 for body in chain.joints[joint - 1 :])


def upright(chain: Chain, joint: int) -> bool:
    """Whether it is the first joint, and its axis is gravity's."""
    return joint == 1 and _stands(chain, joint)


def _stands(chain: Chain, joint: int) -> bool:
    """Whether its axis, and those of all that turn before it, are gravity's."""
    least, T = UPRIGHT * float(np.linalg.norm(chain.gravity)), np.eye(4)
    for k, (part, kind) in enumerate(zip(chain.joints, chain.kinds, strict=True), start=1):
        T = T @ part.T_parent_joint
        turns = kind == "revolute" or k == joint
        if turns and not np.linalg.norm(np.cross(T[:3, :3] @ part.axis, chain.gravity)) < least:
            return False
        if k == joint:
            break
    return True

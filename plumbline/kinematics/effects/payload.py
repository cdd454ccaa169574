r"""A mass at the tip that the controller does not know of.

.. math:: q \leftarrow q - c_0\, (\tau(q, m) - \tau(q, 0))

Every drive twists under the added torque. What a recording shows is the product of mass and
compliance; the mass quoted is that for drives of the compliance :math:`c_0` that is usual for the
arm: drives are made for their load, so that the one with the most to carry twists by some 2 mrad
under it (2e-5 rad/(N m) in arms that carry 10 kg). The mass hangs at the tip frame, or at the
tool's tip, so that the wrist feels the tool as a lever.

No two drives need yield alike: each may twist by a share of its own of what the mass asks of it,

.. math:: q_i \leftarrow q_i - c_0\, (m + m_i)\, \tau_{i,1}, \qquad m_i = m\, \epsilon_i

which is as wide as the mass is found to be large.

Where efforts are measured the mass shows itself, with the place of its centre: what is fitted are
the mass and its first moment about the tip frame, as of a point, or with them its inertia, as of
any body. In a body's numbers torques are linear; a point's have :math:`m c\,(m c)^T / m` besides,
which has no slope where there is no mass.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.dynamics import steiner
from plumbline.kinematics.effects.drive import TORQUES
from plumbline.kinematics.effects.effect import (
    ALL_OBSERVATIONS,
    UNSAID,
    Effect,
    Scope,
    Stage,
    State,
)
from plumbline.kinematics.effects.link_inertia import size_of
from plumbline.kinematics.frames import constant
from plumbline.kinematics.parameters import Parameter
from plumbline.kinematics.weights import as_found

USUAL_TWIST = 2e-3  # rad, of a drive under the most that the bare arm asks of it
SHORTEST_TOOL = 0.01  # m
UNEVEN = 0.3  # 1 sigma of what gears of one series yield under their rated loads [mean]; by hand
LIGHTEST = 1e-2  # kg: rounds the inertia of a mass that may be none


@dataclass(frozen=True)
class Payload(Effect):
    """An unknown mass at the tip, felt through all drives, each of ``compliance`` [rad/(N m)]."""

    at_tool: bool = False
    compliance: float = 2e-5
    drives: tuple[int, ...] = field(default=(), metadata=UNSAID)
    found: tuple[float, ...] = field(default=(), metadata=UNSAID)

    name = "payload"
    stage = Stage.TOOL
    depends_on = "load"
    acts_at = Stage.JOINT
    observations = (*ALL_OBSERVATIONS, *TORQUES)
    needs_gravity = True
    words = (
        "the arm carries a mass at its tip that the model does not know of, or its drives yield as "
        "if it did"
    )
    reference = "Dumas et al. (2011), Robotics and Computer-Integrated Manufacturing 27(4), eq. 9"
    source = (
        "by hand: grippers and tools, a tenth to a half of what arms of 3 to 500 kg are rated for"
    )
    mass = Parameter("kg", 0.0, 500.0, scale=2.0, doc="unknown mass")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The mass, with the compliance that it is quoted for."""
        words = f"{self.mass.doc}, for drives of {self.compliance:.2g} rad/(N m)"
        mass = replace(self.mass, doc=words)
        if not self.drives:
            return (mass,)
        [m], said = self.found, f"{words}, times the share that drive"
        other = replace(mass, lower=-m, upper=m, scale=UNEVEN * m)
        own = (
            replace(other, name=f"of_drive_{j}", doc=f"{said} {j} yields more") for j in self.drives
        )
        return (*as_found((mass,), self.found), *own)

    @property
    def variant(self) -> str:
        """Where the mass hangs, and whether all drives yield alike."""
        return super().variant + ", drives not alike" * bool(self.drives)

    def deviations(self, scope: Scope, values: Sequence[float]) -> Sequence[Effect]:
        """The same mass on drives that do not yield alike."""
        drives = tuple(scope.turning) if values[0] > 0.0 else ()
        return [replace(self, drives=drives, found=tuple(values))] if len(drives) > 1 else []

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """At the tip frame, and at the tool's tip where that lies elsewhere."""
        if scope.observation in TORQUES:
            return CarriedMass.forms(scope)
        places = (False, True) if np.linalg.norm(scope.tool) > SHORTEST_TOOL else (False,)
        if not scope.chain.has_masses:
            return [cls(at_tool) for at_tool in places]
        most = max(map(scope.chain.typical_load, scope.joints))
        return [cls(at_tool, float(f"{USUAL_TWIST / most:.2g}")) for at_tool in places]

    def apply(self, state: State, *values: cs.SX) -> State:
        tip = state.nominal.frames[-1]
        place = tip.point(state.tool) if self.at_tool else tip.t
        load, own = state.nominal.load_at(place), dict(zip(self.drives, values[1:], strict=True))
        for joint, kind in enumerate(state.chain.kinds, start=1):
            if kind == "revolute":
                felt = values[0] + own.get(joint, 0.0)
                state = state.move_joint(joint, -self.compliance * felt * load[joint - 1])
        return state


@dataclass(frozen=True)
class CarriedMass(Effect):
    """The same where efforts are measured: a point's mass and first moment at the tip frame.

    Or, ``extended``, any body's. Declared for an arm of one kilogram that reaches one metre; on
    others it and its bounds are as large as the arm is heavy, ``arm`` [kg], and long, ``reach``
    [m].
    """

    extended: bool = False
    arm: float = field(default=1.0, metadata=UNSAID)
    reach: float = field(default=1.0, metadata=UNSAID)

    name = "payload"
    stage = Stage.TOOL
    observations = TORQUES
    words = "the arm carries a mass at its tip that the model does not know of"
    reference = "Swevers, Verdonck, De Schutter (2007), IEEE Control Systems 27(5) (payload)"
    source = (
        "makers rate arms for .17 to .47 of their own mass; by hand: grippers and tools are a "
        "tenth to a half of that (geometric means: .06), a tenth of the reach off along each axis "
        "and as far about their centre, of which two squares each make an inertia; the bounds are "
        "ten arms"
    )
    mass = Parameter("kg", 0.0, 10.0, scale=0.06, doc="unknown mass")
    x, y, z = Parameter(
        "kg m", -10.0, 10.0, scale=6e-3, doc="mass times its centre's {} in the tip frame"
    ).each(*"xyz")
    xx, yy, zz = Parameter(
        "kg m^2", -10.0, 10.0, scale=2.4e-3, doc="inertia {} about the tip frame"
    ).each("xx", "yy", "zz")
    xy, xz, yz = Parameter(
        "kg m^2", -10.0, 10.0, scale=6e-4, doc="inertia {} about the tip frame"
    ).each("xy", "xz", "yz")

    @property
    def variant(self) -> str:
        """A body, if it is not a point."""
        return "a body of any inertia" if self.extended else ""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """As wide as the arm is heavy, and long; a point has no inertia of its own."""
        sizes = self.arm * self.reach ** np.repeat((0.0, 1.0, 2.0), (1, 3, 6))
        asked = self.declared[: None if self.extended else 4]
        return tuple(p.of_width(float(s)) for p, s in zip(asked, sizes, strict=False))

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """A point, and a body, at the tip frame."""
        return [cls(extended, *size_of(scope.chain)) for extended in (False, True)]

    def apply(self, state: State, *values: cs.SX) -> State:
        body, T = state.chain.body_of_tip, constant(state.chain.T_last_tip)
        mass, place, away = values[0], T[:3, 3], T[:3, :3] @ cs.vertcat(*values[1:4])
        moment = mass * place + away
        # Of m (p + c) (p + c)^T what is linear in m and m c; m c c^T is a body's own.
        both = steiner(1.0, place + away) - steiner(1.0, place) - steiner(1.0, away)
        own = steiner(1 / (mass + LIGHTEST), away)
        if self.extended:
            own = _turned(T[:3, :3], cs.vertcat(*values[4:]))
        inertial = cs.SX(state.inertial)
        inertial[body, :] += cs.vertcat(mass, moment, steiner(mass, place) + both + own).T
        return replace(state, inertial=inertial)


def _turned(R: cs.SX, inertia: cs.SX) -> cs.SX:
    """An inertia (6,) xx, yy, zz, xy, xz, yz turned by R: xx, xy, yy, xz, yz, zz."""
    xx, yy, zz, xy, xz, yz = cs.vertsplit(inertia)
    own = cs.blockcat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    turned = R @ own @ R.T
    return cs.vertcat(*(turned[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))))

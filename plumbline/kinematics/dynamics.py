r"""Inverse dynamics of a robot of any tree shape, in CasADi symbols.

Newton and Euler joint by joint, in each joint's own frame (Featherstone 2008, Rigid Body Dynamics
Algorithms, table 5.1), with a body's mass m, first moment h = m c and inertia J about the joint:

.. math:: f = m\,a + \dot w \times h + w \times (w \times h), \qquad
          n = J \dot w + w \times J w + h \times a

so that torques are linear in the ten inertial parameters of every body (Atkeson, An, Hollerbach
1986, eq. 8). Gravity is an acceleration of the base upwards. A base that floats is held: its first
six coordinates stay where they are. Pinocchio computes the same numbers from the same model.

What gravity asks of a part of the arm: the weight of all that it carries, and its moment.

.. math:: F = \sum_{k \ge i} m_k\, g, \qquad M = \sum_{k \ge i} (p_k - o) \times m_k\, g

over the bodies from joint i outwards and the payload at the tip.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from typing import Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.kinematics.chain import Chain, Joint
from plumbline.kinematics.evaluate import Array, over_rows
from plumbline.kinematics.frames import Transform, constant
from plumbline.kinematics.oracle import pin

INERTIAL = 10  # parameters of a body: mass, first moment (3), inertia about the joint (6)


@dataclass(frozen=True, eq=False)
class RigidBody:
    """What a joint carries with all that is fixed to it."""

    mass: cs.SX  # [kg]
    moment: cs.SX  # mass times its centre (3,), in the joint's frame [kg m]
    inertia: cs.SX  # about the joint's origin (3, 3) [kg m^2]

    @classmethod
    def of(cls, parameters: cs.SX) -> Self:
        """From its ten parameters: m, hx, hy, hz, Jxx, Jxy, Jyy, Jxz, Jyz, Jzz."""
        p = [parameters[k] for k in range(INERTIAL)]
        rows = [cs.horzcat(*(p[k] for k in row)) for row in ((4, 5, 7), (5, 6, 8), (7, 8, 9))]
        return cls(p[0], cs.vertcat(*p[1:4]), cs.vertcat(*rows))

    def wrench(self, w: cs.SX, dw: cs.SX, a: cs.SX) -> tuple[cs.SX, cs.SX]:
        """Force (3,) [N] and torque (3,) [N m] at the joint that move it so.

        Args:
            w: Angular velocity (3,) [rad/s].
            dw: Angular acceleration (3,) [rad/s^2].
            a: Acceleration (3,) of the joint's origin, gravity's taken away [m/s^2].
        """
        h, J = self.moment, self.inertia
        force = self.mass * a + cs.cross(dw, h) + cs.cross(w, cs.cross(w, h))
        torque = J @ dw + cs.cross(w, J @ w) + cs.cross(h, a)
        return force, torque


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Joints of a tree, base first, and what they carry."""

    model: pin.Model  # the Pinocchio model of just these joints: the oracle of every number here
    joints: tuple[Joint, ...]  # the movable joints (n)
    parents: tuple[int, ...]  # the joint that each hangs on, from 0; -1 at the base (n)
    inertial: Array  # ten parameters of every body (n, 10) [kg, kg m, kg m^2]
    gravity: Array  # gravity (3,) in the base frame [m/s^2]

    def __repr__(self) -> str:
        return f"<Dynamics of {self.n} joints, {self.inertial[:, 0].sum():.3g} kg>"

    def __getstate__(self) -> dict[str, object]:
        """What it is without what was worked out from it: symbols stay in their own process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def inverse(
        self, q: cs.SX, v: cs.SX, a: cs.SX, inertial: cs.SX | None = None,
        gravity: cs.SX | None = None,
    ) -> cs.SX:  # fmt: skip
        """Torques (n,) [N m or N] at joints q, velocities v and accelerations a (n,).

        ``inertial`` (n, 10) and ``gravity`` (3,) [m/s^2] take the place of the robot's own.
        """
        own = constant(self.inertial) if inertial is None else inertial
        up = -(constant(self.gravity) if gravity is None else gravity)
        moved = self._motions(q, v, a, up)
        forces = [
            RigidBody.of(own[i, :]).wrench(*moved[i][1:]) for i in range(self.n)
        ]  # at its own joint, the bodies behind it still missing
        torques: list[cs.SX] = [cs.SX(0)] * self.n
        for i in reversed(range(self.n)):
            force, torque = forces[i]
            axis = constant(self.joints[i].axis)
            turns = self.joints[i].kind == "revolute"
            torques[i] = cs.dot(axis, torque if turns else force)
            parent = self.parents[i]
            if parent >= 0:
                T = moved[i][0]
                f, n = forces[parent]
                lifted = T.R @ force
                forces[parent] = (f + lifted, n + T.R @ torque + cs.cross(T.t, lifted))
        return cs.vertcat(*torques)

    def _motions(
        self, q: cs.SX, v: cs.SX, a: cs.SX, up: cs.SX
    ) -> list[tuple[Transform, cs.SX, cs.SX, cs.SX]]:
        """``T_parent_joint``, angular velocity and acceleration, acceleration of every joint."""
        found: list[tuple[Transform, cs.SX, cs.SX, cs.SX]] = []
        still = (cs.SX(3, 1), cs.SX(3, 1), up)
        for i, joint in enumerate(self.joints):
            parent = self.parents[i]
            w, dw, acceleration = found[parent][1:] if parent >= 0 else still
            T = Transform.from_matrix(joint.T_parent_joint) @ joint.motion(q[i])
            back, axis = T.R.T, constant(joint.axis)
            at_joint = acceleration + cs.cross(dw, T.t) + cs.cross(w, cs.cross(w, T.t))
            w, dw, at_joint = back @ w, back @ dw, back @ at_joint
            rate = axis * v[i]
            if joint.kind == "revolute":
                dw = dw + axis * a[i] + cs.cross(w, rate)
                w = w + rate
            else:
                at_joint = at_joint + axis * a[i] + 2 * cs.cross(w, rate)
            found.append((T, w, dw, at_joint))
        return found

    @cached_property
    def torque_function(self) -> cs.Function:
        """``row (3 n,): q, v, a -> tau (n,)``, compiled once."""
        row = cs.SX.sym("row", 3 * self.n)
        q, v, a = cs.vertsplit(row, self.n)
        return cs.Function("inverse_dynamics", [row], [cs.densify(self.inverse(q, v, a))])

    @cached_property
    def regressor_function(self) -> cs.Function:
        """``row (3 n,): q, v, a -> Y (n, 10 n)`` with ``tau = Y @ inertial.ravel()``."""
        row, own = cs.SX.sym("row", 3 * self.n), cs.SX.sym("own", INERTIAL * self.n)
        q, v, a = cs.vertsplit(row, self.n)
        tau = self.inverse(q, v, a, cs.reshape(own, INERTIAL, self.n).T)
        return cs.Function("regressor", [row], [cs.densify(cs.jacobian(tau, own))])

    def torques(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Torques (N, n) [N m or N] at rows of q, v and a, each (N, n) (PlumblineError: others)."""
        return over_rows(self.torque_function, self._rows(q, v, a))[0][:, 0]

    def _rows(self, *parts: ArrayLike) -> Array:
        given = [np.atleast_2d(np.asarray(part, dtype=float)) for part in parts]
        shapes = {values.shape for values in given}
        if len(shapes) > 1 or given[0].shape[1] != self.n:
            found = ", ".join("x".join(map(str, values.shape)) for values in given)
            raise PlumblineError(f"q, v, a of shapes {found}: N x {self.n} expected of each")
        return np.hstack(given)


def dynamics_of(model: pin.Model, joints: Sequence[Joint], gravity: ArrayLike) -> Dynamics:
    """Of a Pinocchio model whose joints have one freedom each; gravity (3,) in the base [m/s^2]."""
    bodies = [model.inertias[1 + k] for k in range(len(joints))]
    inertial = np.array([body.toDynamicParameters() for body in bodies], dtype=float)
    parents = tuple(int(model.parents[1 + k]) - 1 for k in range(len(joints)))
    return Dynamics(
        model, tuple(joints), tuple(max(p, -1) for p in parents), inertial,
        np.asarray(gravity, dtype=float),
    )  # fmt: skip


def steiner(mass: cs.SX | float, centre: cs.SX) -> cs.SX:
    """Inertia (6,) xx, xy, yy, xz, yz, zz about the origin of a point mass at ``centre`` (3,)."""
    x, y, z = cs.vertsplit(centre)
    each = (y**2 + z**2, -x * y, x**2 + z**2, -x * z, -y * z, x**2 + y**2)
    return mass * cs.vertcat(*each)


@dataclass(frozen=True, eq=False)
class Nominal:
    """The nominal arm at the joint readings, worked out once and shared by all effects.

    Taken at the readings, not at the deflected posture: the difference is of second order.
    """

    chain: Chain  #: the nominal chain
    q: cs.SX  #: joint readings (n,) [rad or m]
    payload: cs.SX  #: known payload [kg]

    @classmethod
    def at(cls, chain: Chain, row: Mapping[str, cs.SX]) -> Nominal:
        """At the symbols of a row: what is shared where these are the shared ones."""
        shared = nominal_of(chain, carrying="payload" in row)
        payload = row.get("payload", shared.payload)
        if row["q"] is shared.q and payload is shared.payload:
            return shared
        return cls(chain, row["q"], payload)

    @cached_property
    def load(self) -> cs.SX:
        """Torque (n,) that the drives hold against gravity [N m or N]."""
        return self._borne(self.chain.gravity_torque(self.q, self.payload))

    def _borne(self, torque: cs.SX) -> cs.SX:
        """Torque (n,) of every joint with that of the joints which follow it."""
        borne = cs.SX(torque)
        for j, joint in enumerate(self.chain.joints):
            for k, share in joint.drags:
                borne[j] += share * torque[k]
        return borne

    def load_of(self, shares: cs.SX) -> cs.SX:
        """The same where each body, and last the payload, counts by a share (n + 1)."""
        energy = self.chain.potential_energy(self.q, self.payload * shares[-1], shares)
        return self._borne(cs.gradient(energy, self.q))

    @cached_property
    def frames(self) -> list[Transform]:
        """``T_base_joint`` of every joint and last the tip (n + 1)."""
        return self.chain.joint_frames(self.q)

    def load_at(self, place: cs.SX, force: cs.SX | None = None) -> cs.SX:
        """Torque (n,) that one kilogram at a place (3,) of the base frame asks [N m or N].

        Or a force (3,) [N] there, in that frame.
        """
        force = constant(self.chain.gravity) if force is None else force
        return self._borne(cs.gradient(-cs.dot(place, force), self.q))


@lru_cache(maxsize=32)
def nominal_of(chain: Chain, *, carrying: bool) -> Nominal:
    """The nominal arm in symbols of its own, worked out once for all models of it.

    Carrying what a row says, or nothing.
    """
    payload = cs.SX.sym("payload") if carrying else cs.SX(0)
    return Nominal(chain, cs.SX.sym("q", chain.n), payload)


def weight_beyond(
    arm: Nominal, joint: int, about: cs.SX, shares: cs.SX | None = None
) -> tuple[cs.SX, cs.SX]:
    """Force (3,) [N] and moment (3,) [N m] of all weights from a joint outwards, in the base frame.

    The joint, from 1, has its own body with it; the moment is about a point (3,) [m]. Each body,
    and last the payload, counts by its share (n + 1), wholly if none are given.
    """
    g, by = constant(arm.chain.gravity), cs.SX.ones(arm.chain.n + 1) if shares is None else shares
    force = arm.payload * by[-1] * g
    moment = cs.cross(arm.frames[-1].t - about, force)
    for k, body in enumerate(arm.chain.joints[joint - 1 :], start=joint - 1):
        if body.mass > 0.0:
            weight = body.mass * by[k] * g
            force += weight
            moment += cs.cross(arm.frames[k].point(constant(body.com)) - about, weight)
    return force, moment

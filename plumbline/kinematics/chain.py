r"""The serial chain of a robot, from its base to one tip frame, in CasADi symbols.

.. math:: T_{base,tip}(q) = \prod_i T_{i-1,i}\, J_i(q_i) \cdot T_{n,tip}, \qquad
          \tau(q) = \partial U / \partial q, \quad U = -\sum_i m_i\, g^T p_i(q)

where :math:`J_i` turns or slides joint i and :math:`p_i` is the centre of mass of body i. Pinocchio
computes the same numbers from the same model; the tests hold the two together.
"""

from __future__ import annotations  # which would load Pinocchio before it is asked

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.kinematics.constants import LEAST_LOAD, MISSTATED, PARALLEL, SHORT
from plumbline.kinematics.evaluate import Array, Flags, over_rows
from plumbline.kinematics.frames import Transform, axis_rotation, by_columns, constant, homogeneous
from plumbline.kinematics.oracle import pin


@dataclass(frozen=True, eq=False)
class Joint:
    """One movable joint and the body behind it."""

    name: str  # its name in the model
    kind: str  # ``"revolute"`` or ``"prismatic"``
    axis: Array  # unit axis (3,) in the joint's own frame
    T_parent_joint: Array  # placement (4, 4) in the previous joint's frame [m]
    lower: float  # lower limit [rad or m], -inf if there is none
    upper: float  # upper limit [rad or m], inf if there is none
    mass: float  # mass of the body, with all that is fixed to it [kg]
    com: Array  # its centre of mass (3,) in the joint's frame [m]
    # which way the normal to the next axis counts (3,), as a table does; from axis to axis if None
    normal: Array | None = None
    # joints that follow it, from 0, and how far they move per its own travel
    drags: tuple[tuple[int, float], ...] = ()

    @property
    def placed(self) -> Array:
        """Its placement and, beside it, its axis, with 1 below that of a slide (4, 5)."""
        slides = float(self.kind == "prismatic")
        return np.column_stack([self.T_parent_joint, [*self.axis, slides]])

    def motion(self, q: cs.SX) -> Transform:
        """The joint's own transform at coordinate q [rad or m]."""
        if self.kind == "revolute":
            return Transform(axis_rotation(self.axis, q), cs.SX(3, 1))
        return Transform(cs.SX.eye(3), constant(self.axis) * q)


@dataclass(frozen=True, eq=False)
class Chain:
    """Joints from the base to a tip frame; everything symbolic comes from here."""

    model: pin.Model  # the Pinocchio model of just these joints: the oracle of every number here
    joints: tuple[Joint, ...]  # the movable joints, base first
    T_last_tip: Array  # tip frame (4, 4) in the last joint's frame [m]
    tip_frame: str  # name of the tip frame
    gravity: Array  # gravity (3,) in the base frame [m/s^2]
    misstated: float = MISSTATED  # 1 sigma of what a body weighs [its mass]

    def __repr__(self) -> str:
        named = f"{self.joints[0].name[:60]!r} to {self.tip_frame[:60]!r}"
        return f"<Chain of {self.n} joints from {named}>"

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, base first."""
        return tuple(joint.name for joint in self.joints)

    @property
    def kinds(self) -> tuple[str, ...]:
        """``"revolute"`` or ``"prismatic"``, joint by joint."""
        return tuple(joint.kind for joint in self.joints)

    @property
    def turning(self) -> Flags:
        """Which joints (n,) are revolute."""
        return np.array(self.kinds) == "revolute"

    @property
    def lower(self) -> Array:
        """Lower joint limits (n,) [rad or m]."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> Array:
        """Upper joint limits (n,) [rad or m]."""
        return np.array([joint.upper for joint in self.joints])

    @property
    def hangs(self) -> Sequence[int]:
        """The joint that each hangs on, from 0; -1 at the base (n)."""
        return range(-1, self.n - 1)

    @property
    def body_of_tip(self) -> int:
        """The body that the tip frame is fixed to, from 0."""
        return self.n - 1

    @property
    def has_masses(self) -> bool:
        """Whether the model says what its bodies weigh."""
        return any(joint.mass > 0.0 for joint in self.joints)

    def __getstate__(self) -> dict[str, object]:
        """What it is without what was worked out from it: symbols stay in their own process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def reach(self) -> float:
        """Upper bound on the tip's distance from the base [m]."""
        fixed = [joint.T_parent_joint for joint in self.joints] + [self.T_last_tip]
        slides = [
            max(abs(joint.lower), abs(joint.upper))
            for joint in self.joints
            if joint.kind == "prismatic" and np.isfinite([joint.lower, joint.upper]).all()
        ]
        return float(sum(math.hypot(*T[:3, 3]) for T in fixed) + sum(slides))

    def typical_load(self, joint: int) -> float:
        """Half of the torque [N m] of all that a joint (from 1) carries, were it stretched level.

        To two digits, and no less than one hundredth of a newton metre.
        """
        reach, torque = 0.0, 0.0
        for k, body in enumerate(self.joints[joint - 1 :]):
            if k:
                reach += float(np.linalg.norm(body.T_parent_joint[:3, 3]))
            torque += body.mass * (reach + float(np.linalg.norm(body.com)))
        torque *= 0.5 * float(np.linalg.norm(self.gravity))
        return float(f"{max(torque, LEAST_LOAD):.2g}")

    @cached_property
    def placements(self) -> tuple[Transform, ...]:
        """Nominal placements: of every joint in its parent, and last of the tip (n + 1)."""
        fixed = [joint.T_parent_joint for joint in self.joints] + [self.T_last_tip]
        return tuple(Transform.from_matrix(T) for T in fixed)

    def joint_frames(
        self, q: cs.SX, placements: Sequence[Transform] | None = None
    ) -> list[Transform]:
        """``T_base_joint`` of every moved joint, and last ``T_base_tip`` (n + 1), at q (n,).

        Placements (n + 1) are the nominal ones if not given.
        """
        placements = placements or self.placements
        frames: list[Transform] = []
        for i, (joint, parent) in enumerate(zip(self.joints, self.hangs, strict=True)):
            T_parent = frames[parent] if parent >= 0 else Transform.identity()
            frames.append(T_parent @ placements[i] @ joint.motion(q[i]))
        return [*frames, frames[self.body_of_tip] @ placements[-1]]

    def forward(self, q: cs.SX, placements: Sequence[Transform] | None = None) -> Transform:
        """``T_base_tip`` at joint coordinates q (n,)."""
        return self.joint_frames(q, placements)[-1]

    def potential_energy(
        self, q: cs.SX, payload: cs.SX | float = 0.0, shares: cs.SX | None = None
    ) -> cs.SX:
        """Potential energy [J] of the bodies and of a point mass ``payload`` [kg] at the tip.

        Each body counts by its share (n or more), wholly if none are given.
        """
        by = cs.SX.ones(self.n) if shares is None else shares
        frames = self.joint_frames(q)
        g = constant(self.gravity)
        energy = cs.SX(0)
        for k, (joint, T) in enumerate(zip(self.joints, frames, strict=False)):
            if joint.mass > 0.0:
                energy -= joint.mass * by[k] * cs.dot(g, T.point(constant(joint.com)))
        return energy - payload * cs.dot(g, frames[-1].t)

    @cached_property
    def gravity_torque(self) -> cs.Function:
        """``(q (n,), payload [kg]) -> tau (n,)`` that holds the arm against gravity [N m or N]."""
        q = cs.SX.sym("q", self.n)
        payload = cs.SX.sym("payload")
        torque = cs.gradient(self.potential_energy(q, payload), q)
        return cs.Function("gravity_torque", [q, payload], [torque], ["q", "payload"], ["tau"])

    @cached_property
    def _placement(self) -> cs.Function:
        q = cs.SX.sym("q", self.n)
        T = self.forward(q)
        return cs.Function("placement", [q], [cs.densify(cs.vertcat(cs.vec(T.R), T.t))])

    def placement(self, q: ArrayLike) -> Array:
        """``T_base_tip`` (N, 4, 4) [m] at postures (N, n) or (n,) (PlumblineError: of others)."""
        postures = self.postures(q)
        return by_columns(over_rows(self._placement, postures)[0][:, 0])

    def postures(self, q: ArrayLike) -> Array:
        """Postures (N, n) from (N, n) or (n,); refused if they are of other joints."""
        try:
            postures = np.atleast_2d(np.asarray(q, dtype=float))
        except (TypeError, ValueError):
            postures = np.empty((0, 0))
        if postures.ndim != 2 or postures.shape[1] != self.n:
            found = " x ".join(map(str, np.shape(postures)))
            raise PlumblineError(
                f"postures of shape {found}, expected N x {self.n} numbers, a column for each of "
                f"the chain's joints to {self.tip_frame[:60]!r}"
            )
        return postures

    def tips(self, q: ArrayLike, tool_offset: ArrayLike) -> Array:
        """Tips (N, 3) in the base [m] at postures (N, n), of a tip (3,) in the tip frame [m]."""
        T_base_tip = self.placement(q)
        tool = np.asarray(tool_offset, dtype=float)
        return np.asarray(T_base_tip[:, :3, :3] @ tool + T_base_tip[:, :3, 3])

    def configuration(self, q: ArrayLike) -> Array:
        """Pinocchio's configuration vector (nq,) of joint coordinates q (n,)."""
        values = np.zeros(self.model.nq)
        for i, angle in enumerate(np.asarray(q, dtype=float)):
            joint = self.model.joints[i + 1]
            unbounded = joint.nq == 2
            values[joint.idx_q : joint.idx_q + joint.nq] = (
                (np.cos(angle), np.sin(angle)) if unbounded else angle
            )
        return values

    def link_frames(self) -> list[Array]:
        """DH-like frame (4, 4) of every link, in the frame of the joint that carries it.

        Its z lies along the next joint's axis, its x along the common normal of the two axes, its
        origin at the foot of that normal: the frame of Denavit and Hartenberg (1955), that of the
        robot's own row where it has one. Axes that are all but parallel (:func:`nearly_parallel`),
        whose common normal may be far away, take the normal through the next joint's origin; the
        last link takes the tip's own frame.
        """
        return list(self._link_frames)

    @cached_property
    def _link_frames(self) -> list[Array]:
        nexts = [*self.joints[1:], None]
        return [_link_frame(a, b, self.T_last_tip) for a, b in zip(self.joints, nexts, strict=True)]


def nearly_parallel(joint: Joint, following: Joint) -> bool:
    """Whether two successive axes are parallel up to a small tilt, sine below 0.05."""
    z1 = following.T_parent_joint[:3, :3] @ following.axis
    return bool(np.linalg.norm(np.cross(joint.axis, z1)) < PARALLEL)


def _link_frame(joint: Joint, following: Joint | None, T_last_tip: Array) -> Array:
    if following is None:
        return T_last_tip
    T = following.T_parent_joint
    z0, z1 = joint.axis, T[:3, :3] @ following.axis
    origin = T[:3, 3]
    if nearly_parallel(joint, following):
        x = origin - z1 * (z1 @ origin)
        if np.linalg.norm(x) < SHORT:
            x = np.eye(3)[int(np.argmin(np.abs(z1)))] if joint.normal is None else joint.normal
            x = x - z1 * (z1 @ x)
    else:
        # Foot on the next axis: origin + s z1 is nearest to the line t z0.
        s = np.linalg.lstsq(np.column_stack([z1, -z0]), -origin, rcond=None)[0][0]
        origin = origin + s * z1
        x = np.cross(z0, z1)
    backwards = joint.normal is not None and x @ joint.normal < 0.0
    x = (-x if backwards else x) / np.linalg.norm(x)
    return homogeneous(np.column_stack([x, np.cross(z1, x), z1]), origin)

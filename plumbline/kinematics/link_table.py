r"""Any serial chain as a table of link parameters, in numbers and in symbols.

.. math:: T_{base,tip}(q) = \prod_k R_z(\theta_k + q_k)\, T_z(d_k)\, T_x(a_k)\,
          R_x(\alpha_k)\, R_y(\beta_k)

A prismatic row adds q to d instead; a fixed row has no q. These are the standard rows of Denavit
and Hartenberg (1955) with the tilt beta of Hayati and Mirmirani (1985, eq. 5), which is zero unless
the row's axis and the next are nearly parallel.

Two axes, wherever they stand, are joined by one row and a screw along the second axis, which the
next row takes up since it commutes with the joint's own motion. So a chain of n joints is exactly n
rows, one fixed row before them and one behind.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import casadi as cs
import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.chain import Chain, Joint
from plumbline.kinematics.constants import DRAWN, PARALLEL, ROUNDING, SAME, SHORT
from plumbline.kinematics.dh import DHRow
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.frames import Transform, homogeneous
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.robot import Robot

KEYS = ("d", "a", "alpha", "theta", "beta")


@dataclass(frozen=True)
class LinkRow:
    """One row of the table."""

    label: str  # what it is called: ``joint 3``, ``base``, ``tip`` or ``link 4``
    dh: DHRow  # its standard parameters, kind, limits and mass
    beta: float = 0.0  # tilt about the y axis, after alpha [rad]
    parallel: bool = False  # whether the next moving axis is nearly parallel to this row's

    @property
    def values(self) -> tuple[float, ...]:
        """d, a [m], alpha, theta, beta [rad], in the order of :data:`KEYS`."""
        return (self.dh.d, self.dh.a, self.dh.alpha, self.dh.theta, self.beta)

    def with_values(self, values: Sequence[float] | Array) -> Self:
        """The row with other parameters, in the order of :data:`KEYS`."""
        d, a, alpha, theta, beta = (float(value) for value in values)
        return replace(self, dh=replace(self.dh, d=d, a=a, alpha=alpha, theta=theta), beta=beta)


@dataclass(frozen=True, eq=False)
class LinkTable:
    """A chain as rows."""

    chain: Chain  # the chain that it is of
    rows: tuple[LinkRow, ...]  # the rows, base first
    # where the chain's own frames stand in those of the rows (n + 2, 4, 4): of the base, of every
    # joint once it has moved, of the tip. Constant, whatever the rows hold.
    anchors: tuple[Array, ...]

    @property
    def values(self) -> Array:
        """Parameters (rows, 5) in the order of :data:`KEYS` [m, m, rad, rad, rad]."""
        return np.array([row.values for row in self.rows])

    def with_values(self, values: Array) -> Self:
        """The same table with other parameters (rows, 5)."""
        rows = zip(self.rows, values, strict=True)
        return replace(self, rows=tuple(row.with_values(new) for row, new in rows))

    def tip(self, values: cs.SX, q: cs.SX, tool: cs.SX) -> cs.SX:
        """A point (3,) [m] of the tip frame, in the base frame, by parameters (rows, 5) at (n,)."""
        point = Transform.from_matrix(self.anchors[-1]).point(tool)
        steps, j = [], 0
        for k, row in enumerate(self.rows):
            motion: cs.SX | None = None
            if row.dh.kind != "fixed":
                motion, j = q[j], j + 1
            steps.append(row_transform(values[k, :], row.dh.kind, motion))
        # From the tip inwards a row costs a product with a vector, not with a matrix.
        for step in reversed(steps):
            point = step.point(point)
        return Transform.from_matrix(self.anchors[0]).inverse().point(point)

    def placements(self) -> tuple[Array, ...]:
        """Placement (4, 4) of every joint in its parent, last of the tip: those of a chain (n+1).

        Frames are the chain's own, so that axes and limits of the chain stay valid.
        """
        found, T, j = [], np.linalg.inv(self.anchors[0]), 0
        for row in self.rows:
            if row.dh.kind != "fixed":
                j += 1
                found.append(T @ self.anchors[j])
                T = np.linalg.inv(self.anchors[j])
            T = T @ row_matrix(row)
        return (*found, T @ self.anchors[-1])


def row_transform(values: cs.SX, kind: str, motion: cs.SX | None) -> Transform:
    """Transform of one row from its symbols (5,) and the joint's motion, None for a fixed row."""
    d, a, alpha, theta, beta = (values[k] for k in range(5))
    if motion is not None:
        theta, d = (theta + motion, d) if kind == "revolute" else (theta, d + motion)
    ct, st, ca, sa = cs.cos(theta), cs.sin(theta), cs.cos(alpha), cs.sin(alpha)
    R = cs.vertcat(
        cs.horzcat(ct, -st * ca, st * sa), cs.horzcat(st, ct * ca, -ct * sa), cs.horzcat(0, sa, ca)
    )
    if not beta.is_zero():
        cb, sb = cs.cos(beta), cs.sin(beta)
        tilted, upright = R[:, 0], R[:, 2]
        R = cs.horzcat(tilted * cb - upright * sb, R[:, 1], tilted * sb + upright * cb)
    return Transform(R, cs.vertcat(a * ct, a * st, d))


def row_matrix(row: LinkRow) -> Array:
    """Transform (4, 4) of one row, its joint at zero."""
    d, a, alpha, theta, beta = row.values
    tilt = homogeneous(pin.utils.rotate("y", beta), np.zeros(3))
    return homogeneous(pin.utils.rotate("z", theta), (0.0, 0.0, d)) @ (
        homogeneous(pin.utils.rotate("x", alpha), (a, 0.0, 0.0)) @ tilt
    )


def link_table(robot: Robot, chain: Chain) -> LinkTable:
    """The table of a robot's chain (PlumblineError): its own DH rows, or drawn from its axes."""
    table = _own_rows(robot, chain) if robot.dh is not None else drawn_rows(chain)
    nominal = [joint.T_parent_joint for joint in chain.joints] + [chain.T_last_tip]
    found = zip(nominal, table.placements(), strict=True)
    worst = float(np.max([np.abs(mine - theirs).max() for mine, theirs in found]))
    if not worst < DRAWN:
        raise PlumblineError(
            f"chain to {chain.tip_frame!r}: link parameters miss its frames by {worst:.1e}, at "
            f"most {DRAWN:.0e} allowed; check the axes and origins of its joints"
        )
    return table


def _own_rows(robot: Robot, chain: Chain) -> LinkTable:
    rows = list(robot.dh or ())
    if chain.tip_frame != robot.default_tip:
        rows = rows[: int(chain.tip_frame.removeprefix("link"))]
    table, anchors, j = [], [np.eye(4)], 0
    for number, row in enumerate(rows, start=1):
        moves = row.kind != "fixed"
        j += moves
        if moves:
            anchors.append(homogeneous(pin.utils.rotate("z", row.theta), np.zeros(3)))
        label = f"joint {j}" if moves else "tip" if number == len(rows) else f"link {number}"
        behind = [later.kind for later in rows[number:]]
        parallel = moves and behind[:1] not in ([], ["fixed"]) and _is_parallel(row.alpha)
        table.append(LinkRow(label, row, parallel=parallel))
    return LinkTable(chain, tuple(table), (*anchors, np.eye(4)))


def _is_parallel(alpha: float) -> bool:
    return bool(abs(np.sin(alpha)) < PARALLEL)


def drawn_rows(chain: Chain) -> LinkTable:
    """Rows along the common normals of the joints' axes."""
    rows, anchors = [], [np.eye(4)]
    label, kind, T_anchor = "base", "fixed", np.eye(4)
    previous: Joint | None = None
    for j, joint in enumerate(chain.joints, start=1):
        turn = homogeneous(_axis_to_z(joint.axis), np.zeros(3))
        values, rest = _joined(T_anchor @ joint.T_parent_joint @ turn)
        rows.append(_row(label, kind, values, previous, parallel=previous is not None))
        label, kind, previous = f"joint {j}", joint.kind, joint
        T_anchor = rest @ np.linalg.inv(turn)
        anchors.append(T_anchor)
    values, rest = _joined(T_anchor @ chain.T_last_tip)
    rows.append(_row(label, kind, values, previous, parallel=False))
    if not np.allclose(rest, np.eye(4), atol=SAME):
        screw = np.array([rest[2, 3], 0.0, 0.0, np.arctan2(rest[1, 0], rest[0, 0]), 0.0])
        rows.append(_row("tip", "fixed", screw, None, parallel=False))
    kept = rows if any(rows[0].values) else rows[1:]  # an empty base is no row
    return LinkTable(chain, tuple(kept), (*anchors, np.eye(4)))


def _row(label: str, kind: str, values: Array, joint: Joint | None, *, parallel: bool) -> LinkRow:
    d, a, alpha, theta, beta = (float(value) for value in values)
    row = DHRow(d, a, alpha, theta, kind)
    if joint is not None:
        row = replace(row, lower=joint.lower, upper=joint.upper, mass=joint.mass)
    return LinkRow(label, row, beta, parallel and _is_parallel(np.hypot(np.sin(alpha), beta)))


def _joined(T: Array) -> tuple[Array, Array]:
    """Row (5,) from a z axis to that of a frame (4, 4), and the screw (4, 4) left over."""
    z, p = T[:3, 2], T[:3, 3]
    sine = float(np.hypot(z[0], z[1]))
    if sine < PARALLEL:
        foot = p - p[2] / z[2] * z  # where the second axis meets the first one's xy plane
        a, theta = float(np.hypot(foot[0], foot[1])), float(np.arctan2(foot[1], foot[0]))
        a, theta = (a, theta) if a > SHORT else (0.0, 0.0)
        x, y, up = pin.utils.rotate("z", -theta) @ z
        values = np.array([0.0, a, np.arctan2(-y, up), theta, np.arcsin(np.clip(x, -1.0, 1.0))])
    else:
        x_axis = np.array([-z[1], z[0], 0.0]) / sine
        along = float((p @ z - z[2] * p[2]) / sine**2)  # from the foot on the second axis to p
        foot = p - along * z
        theta, alpha = np.arctan2(x_axis[1], x_axis[0]), np.arctan2(sine, z[2])
        values = np.array([foot[2], x_axis @ foot, alpha, theta, 0.0])
    values[np.abs(values) < ROUNDING] = 0.0
    row = LinkRow("", DHRow(kind="fixed")).with_values(values)
    return values, np.linalg.inv(row_matrix(row)) @ T


def _axis_to_z(axis: Array) -> Array:
    """A rotation (3, 3) whose third column is the axis; the identity where that is z."""
    z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    if np.allclose(z, (0.0, 0.0, 1.0), atol=ROUNDING):
        return np.eye(3)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - z * (z @ x)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])

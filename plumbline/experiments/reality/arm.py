"""The arm as it stands: geometry, weight, and what gravity does to it.

Standard Denavit-Hartenberg rows, joint i moving frame i against frame i - 1:

    T_{i-1,i} = Rz(theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i)

with q_i added to theta_i (revolute) or to d_i (prismatic). The load that gravity puts on joint i is
summed from the tip inwards:

    f_i = m_i g + f_{i+1}
    n_i = (c_i - o_{i-1}) x m_i g + n_{i+1} + (o_i - o_{i-1}) x f_{i+1}

about the origin o_{i-1} of the joint's own frame, and its component along the joint's axis is the
load torque.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STANDARD_GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Arm:
    """A serial arm: DH rows, masses, and the joint range that a session uses."""

    name: str  # the arm's name
    d: Array  # (n,) offsets along the joint axes [m]
    a: Array  # (n,) link lengths [m]
    alpha: Array  # (n,) twists [rad]
    theta: Array  # (n,) joint zero offsets [rad]
    prismatic: NDArray[np.bool_]  # (n,) true where the joint slides
    mass: Array  # (n,) link masses [kg]
    com: Array  # (n, 3) centres of mass in the links' DH frames [m]
    lower: Array  # (n,) smallest joint readings in a session [rad or m]
    upper: Array  # (n,) largest joint readings in a session [rad or m]
    gravity: Array  # (3,) gravity in the base frame [m/s^2]
    # the name under which a recording refers to the arm; None writes its DH rows out
    bundled: str | None = None
    tip_frame: str = "flange"  # name of the last link's frame

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.d)

    def with_mass(self, mass: Array) -> Self:
        """The same arm with other link masses, (n,) [kg]."""
        return replace(self, mass=np.asarray(mass, dtype=float))


@dataclass(frozen=True)
class Shape:
    """Geometry row by row: what the links measure at each reading."""

    d: Array  # (N, n) offsets [m]
    a: Array  # (N, n) lengths [m]
    alpha: Array  # (N, n) twists [rad]
    # (N, n, 6) displacement [m] and rotation [rad] added at the end of each link, in the link's DH
    # frame
    flex: Array

    @classmethod
    def of(cls, arm: Arm, rows: int) -> Self:
        """The drawing's geometry, repeated for every row."""
        spread = np.ones((rows, 1))
        return cls(
            arm.d * spread, arm.a * spread, arm.alpha * spread, np.zeros((rows, arm.joints, 6))
        )


def rotations(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad], by Rodrigues' formula."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    cross = np.zeros((*vector.shape[:-1], 3, 3))
    x, y, z = np.moveaxis(vector, -1, 0)
    cross[..., 0, 1], cross[..., 0, 2] = -z, y
    cross[..., 1, 0], cross[..., 1, 2] = z, -x
    cross[..., 2, 0], cross[..., 2, 1] = -y, x
    sine = np.sinc(angle / np.pi)
    versine = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def placed(R: Array, t: Array) -> Array:
    """Transforms (..., 4, 4) of rotations (..., 3, 3) and places (..., 3) [m]."""
    T = np.tile(np.eye(4), (*R.shape[:-2], 1, 1))
    T[..., :3, :3], T[..., :3, 3] = R, t
    return T


def forward(arm: Arm, q: Array, shape: Shape | None = None) -> Array:
    """Frames of all links (N, n + 1, 4, 4) in the base frame, the base itself first.

    At true joint positions q (N, n) [rad or m]; the geometry by row is the drawing's when omitted.
    """
    rows = len(q)
    shape = Shape.of(arm, rows) if shape is None else shape
    frames = np.empty((rows, arm.joints + 1, 4, 4))
    frames[:, 0] = np.eye(4)
    for i in range(arm.joints):
        frames[:, i + 1] = frames[:, i] @ link_frame(arm, q[:, i], shape, i)
    return frames


def link_frame(arm: Arm, q: Array, shape: Shape, i: int) -> Array:
    """Frames (N, 4, 4) of link i (from 0) in that of the link before, at q (N,) [rad or m]."""
    theta = np.full(len(q), arm.theta[i]) if arm.prismatic[i] else q + arm.theta[i]
    d = shape.d[:, i] + q if arm.prismatic[i] else shape.d[:, i]
    a, alpha = shape.a[:, i], shape.alpha[:, i]
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    zero, one = np.zeros_like(d), np.ones_like(d)
    entries = [
        [ct, -st * ca, st * sa, a * ct],
        [st, ct * ca, -ct * sa, a * st],
        [zero, sa, ca, d],
        [zero, zero, zero, one],
    ]
    link = np.moveaxis(np.array(entries), -1, 0)
    flex = shape.flex[:, i]
    if not flex.any():
        return np.asarray(link)
    return np.asarray(link @ placed(rotations(flex[:, 3:]), flex[:, :3]))


def loads(arm: Arm, frames: Array) -> tuple[Array, Array]:
    """What gravity puts on every joint: force and moment of all that hangs outboard.

    Forces (N, n, 3) [N] and moments (N, n, 3) [N m] about each joint frame's origin, in the base
    frame, of an arm whose link frames (N, n + 1, 4, 4) are those of `forward`.
    """
    rows = len(frames)
    force, moment = np.zeros((rows, arm.joints, 3)), np.zeros((rows, arm.joints, 3))
    f, m = np.zeros((rows, 3)), np.zeros((rows, 3))
    for i in reversed(range(arm.joints)):
        origin, end = frames[:, i, :3, 3], frames[:, i + 1, :3, 3]
        centre = end + frames[:, i + 1, :3, :3] @ arm.com[i]
        weight = arm.mass[i] * arm.gravity
        m = np.cross(centre - origin, weight) + m + np.cross(end - origin, f)
        f = f + weight
        force[:, i], moment[:, i] = f, m
    return force, moment


def load_torque(arm: Arm, frames: Array) -> Array:
    """Generalised gravity load (N, n) [N m or N]: positive drives the joint towards larger q."""
    force, moment = loads(arm, frames)
    along = np.where(arm.prismatic[None, :, None], force, moment)
    return np.asarray(np.einsum("nik,nik->ni", frames[:, :-1, :3, 2], along))


def point_torque(arm: Arm, frames: Array, point: Array, force: Array) -> Array:
    """Generalised load (N, n) of a force (3,) [N] at points (N, 3) [m], both in the base frame."""
    lever = point[:, None] - frames[:, :-1, :3, 3]
    pushed = np.broadcast_to(force, lever.shape)
    along = np.where(arm.prismatic[None, :, None], pushed, np.cross(lever, pushed))
    return np.asarray(np.einsum("nik,nik->ni", frames[:, :-1, :3, 2], along))

r"""Where tip and top of a needle are that points at a lesion from a puncture angle.

.. math:: u = (\sin\theta\cos\beta,\ \sin\theta\sin\beta,\ \cos\theta), \qquad
          p_{tip} = T_{RC}\,(f_C + r u), \qquad p_{top} = T_{RC}\,(f_C + (r + l)\, u)

:math:`\theta` is measured from the z axis of the CT, :math:`\beta` from its x axis; the tip stands
off from the lesion f by r, and l is the needle's length (Chen et al., eqs. 10-15). The tool centre
point lies l + r from the flange along the needle, which is on the lesion: turning about that point
alone points the needle elsewhere, a remote centre of motion made by software.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import Transform
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing.constants import RIGHT_ANGLE
from plumbline.optim.pointing.given import array, number, rigid


@dataclass(frozen=True)
class Needle:
    """A rigid needle on a flange.

    Attributes:
        length: From the flange to the needle's tip, l [m].
        standoff: From the tip to the lesion, r [m].
        axis: Unit direction (3,) of the needle in the flange's frame.
        radius: Its radius [m].
    """

    length: float
    standoff: float
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    radius: float = 1.0e-3

    def __post_init__(self) -> None:
        for name in ("length", "standoff", "radius"):
            object.__setattr__(
                self, name, number(getattr(self, name), f"needle {name} [m]", above=0.0)
            )
        if self.reach > 5.0:
            raise PlumblineError(
                f"needle length + standoff = {self.reach:g} m: at most 5 m; give metres, not mm"
            )
        axis = array(self.axis, "needle axis", (3,), "give a direction in the flange's frame")
        size = float(np.linalg.norm(axis))
        if size < 1e-9:
            raise PlumblineError(
                "needle axis = 0 0 0: a direction expected; (0, 0, 1) is the flange's z"
            )
        x, y, z = (float(value) for value in axis / size)
        object.__setattr__(self, "axis", (x, y, z))

    @property
    def reach(self) -> float:
        """From the flange to the tool centre point on the lesion, l + r [m]."""
        return self.length + self.standoff


def direction(theta: cs.SX, beta: cs.SX) -> cs.SX:
    """Unit vector u (3,) from the lesion towards the needle, in CT [rad]; eqs. 10-12."""
    return cs.vertcat(cs.sin(theta) * cs.cos(beta), cs.sin(theta) * cs.sin(beta), cs.cos(theta))


def pointed(T_robot_ct: Transform, lesion: cs.SX, angles: cs.SX, lengths: cs.SX) -> cs.SX:
    """Tip and top (3, 2) in the robot's frame, of theta and beta (2,) [rad], r and l (2,) [m]."""
    u = direction(angles[0], angles[1])
    tip = T_robot_ct.point(lesion + lengths[0] * u)
    top = T_robot_ct.point(lesion + (lengths[0] + lengths[1]) * u)
    return cs.horzcat(tip, top)


@cache
def _pointed() -> cs.Function:
    R, t, lesion = cs.SX.sym("R", 3, 3), cs.SX.sym("t", 3), cs.SX.sym("lesion", 3)
    lengths, angles = cs.SX.sym("lengths", 2), cs.SX.sym("angles", 2)
    both = pointed(Transform(R, t), lesion, angles, lengths)
    return cs.Function("pointed", [R, t, lesion, lengths, angles], [cs.densify(both)])


def tip_and_top(
    T_robot_ct: ArrayLike, lesion: ArrayLike, needle: Needle, theta: ArrayLike, beta: ArrayLike
) -> tuple[Array, Array]:
    """Tips and tops of the needle in the robot's frame, each (..., 3) [m], for many angles.

    Args:
        T_robot_ct: From CT to robot coordinates (4, 4) [m].
        lesion: In CT coordinates (3,) [m].
        needle: Its length and stand-off.
        theta: Puncture angles from the CT's z axis, broadcast against beta [rad].
        beta: Azimuths from the CT's x axis [rad].

    Raises:
        PlumblineError: An angle, the lesion or the transform cannot be used.
    """
    T = rigid(T_robot_ct, "T_robot_ct")
    f = array(lesion, "lesion", (3,), "give its CT coordinates in m")
    thetas, betas = checked_angles(theta, beta)
    rows = np.column_stack([thetas.ravel(), betas.ravel()])
    lengths = [needle.standoff, needle.length]
    found = over_rows(_pointed(), rows, T[:3, :3].T, T[:3, 3], f, lengths)[0]
    return found[:, 0].reshape(*thetas.shape, 3), found[:, 1].reshape(*thetas.shape, 3)


def directions(theta: Array, beta: Array) -> Array:
    """Unit vectors u (..., 3) in CT coordinates of angles of one shape [rad]."""
    sine = np.sin(theta)
    return np.stack([sine * np.cos(beta), sine * np.sin(beta), np.cos(theta)], axis=-1)


def checked_angles(theta: ArrayLike, beta: ArrayLike) -> tuple[Array, Array]:
    """Angles broadcast against each other, refused outside of 0 to 90 degrees and one turn."""
    try:
        thetas, betas = np.broadcast_arrays(np.asarray(theta, float), np.asarray(beta, float))
    except (TypeError, ValueError):
        raise PlumblineError(
            f"theta {np.shape(theta)} and beta {np.shape(beta)}: numbers of shapes that broadcast "
            "expected; give one beta for each theta"
        ) from None
    if not thetas.size:
        raise PlumblineError("theta and beta: no angles, at least 1 expected; give some in rad")
    for name, values, low, high in (
        ("theta", thetas, 0.0, RIGHT_ANGLE),
        ("beta", betas, -2 * np.pi, 2 * np.pi),
    ):
        wrong = ~((values >= low - 1e-12) & (values <= high + 1e-12))
        if wrong.any():
            value = float(values[wrong].flat[0])
            raise PlumblineError(
                f"{name} = {value:g} rad: {low:.4g} to {high:.4g} rad expected; give radians"
                + (" between the CT's z axis and its xy plane" if name == "theta" else "")
            )
    return np.array(thetas), np.array(betas)

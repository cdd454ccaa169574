r"""What a needle shall point at, with which arm, past which body.

Where tip and top of a needle are that points at a lesion from a puncture angle.

.. math:: u = (\sin\theta\cos\beta,\ \sin\theta\sin\beta,\ \cos\theta), \qquad
          p_{tip} = T_{RC}\,(f_C + r u), \qquad p_{top} = T_{RC}\,(f_C + (r + l)\, u)

:math:`\theta` is measured from the z axis of the CT, :math:`\beta` from its x axis; the tip stands
off from the lesion f by r, and l is the needle's length (Chen et al., eqs. 10-15). The tool centre
point lies l + r from the flange along the needle, which is on the lesion: turning about that point
alone points the needle elsewhere, a remote centre of motion made by software.
"""

from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import Declared, Point, Positive, expect
from plumbline.errors import PlumblineError
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.frames import Transform
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing import constants
from plumbline.optim.pointing.body import Body
from plumbline.optim.pointing.given import array, rigid
from plumbline.optim.pointing.mesh import Scene
from plumbline.optim.recording import storing as storing


@dataclass(frozen=True)
class Needle(Declared):
    """A rigid needle on a flange."""

    length: Positive  #: from the flange to the needle's tip, l [m]
    standoff: Positive  #: from the tip to the lesion, r [m]
    #: unit direction (3,) of the needle in the flange's frame
    axis: Point = (0.0, 0.0, 1.0)
    radius: Positive = 1.0e-3  #: its radius [m]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.reach > constants.LARGEST:
            raise PlumblineError(
                f"needle length + standoff = {self.reach:g} m: at most 5 m; give metres, not mm"
            )
        size = float(np.linalg.norm(self.axis))
        if size < constants.ROUNDING:
            raise PlumblineError(
                "needle axis = 0 0 0: a direction expected; (0, 0, 1) is the flange's z"
            )
        x, y, z = (float(value) for value in np.asarray(self.axis) / size)
        object.__setattr__(self, "axis", (x, y, z))

    @property
    def reach(self) -> float:
        """From the flange to the tool centre point on the lesion, l + r [m]."""
        return self.length + self.standoff


def pointed(T_robot_ct: Transform, lesion: cs.SX, angles: cs.SX, lengths: cs.SX) -> cs.SX:
    """Tip and top (3, 2) in the robot's frame, of theta and beta (2,) [rad], r and l (2,) [m]."""
    theta, beta = angles[0], angles[1]
    u = cs.vertcat(cs.sin(theta) * cs.cos(beta), cs.sin(theta) * cs.sin(beta), cs.cos(theta))
    tip = T_robot_ct.point(lesion + lengths[0] * u)
    top = T_robot_ct.point(lesion + (lengths[0] + lengths[1]) * u)
    return cs.horzcat(tip, top)


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
    u = directions(thetas, betas)
    tip, top = (
        (f + length * u) @ T[:3, :3].T + T[:3, 3] for length in (needle.standoff, needle.reach)
    )
    return tip, top


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
        ("theta", thetas, 0.0, constants.RIGHT_ANGLE),
        ("beta", betas, -2 * np.pi, 2 * np.pi),
    ):
        wrong = ~(
            (values >= low - constants.ANGLE_ROUNDING) & (values <= high + constants.ANGLE_ROUNDING)
        )
        if wrong.any():
            value = float(values[wrong].flat[0])
            raise PlumblineError(
                f"{name} = {value:g} rad: {low:.4g} to {high:.4g} rad expected; give radians"
                + (" between the CT's z axis and its xy plane" if name == "theta" else "")
            )
    return np.array(thetas), np.array(betas)


@dataclass(frozen=True, eq=False)
class Aim:
    """An arm with a needle, and the lesion that its tool centre point shall stay on."""

    chain: Chain  #: the arm, from its base to the flange that carries the needle
    T_robot_ct: Array  #: from CT to robot base coordinates (4, 4) [m]
    lesion: Array  #: in CT coordinates (3,) [m]
    needle: Needle  #: its length, stand-off and direction in the flange's frame
    #: what the lesion lies in, the skin; None if the needle need not come into anything
    body: Body | None = None
    arm_radius: float = 0.045  #: radius of the capsules that stand for the arm's links [m]
    #: organs, vessels and bones in CT, table and stands in the robot's frame. With neither body nor
    #: scene collisions do not matter; with either the needle must miss its own arm.
    scene: Scene | None = None

    def __init__(
        self,
        chain: Chain,
        T_robot_ct: ArrayLike,
        lesion: ArrayLike,
        needle: Needle,
        body: Body | None = None,
        arm_radius: float = 0.045,
        scene: Scene | None = None,
    ) -> None:
        """Check everything at once.

        Raises:
            PlumblineError: Too few joints, a transform that is not rigid, a lesion that is not
                finite or far from the robot, lies outside of the body or inside of what the needle
                may not enter.
        """
        if chain.n < constants.LEAST_JOINTS:
            raise PlumblineError(
                f"arm of {chain.n} joints: at least {constants.LEAST_JOINTS} needed to hold a "
                "point and a direction; choose another arm or tip frame"
            )
        f = array(lesion, "lesion", (3,), "give its CT coordinates in m")
        if body is not None:
            depth = float(body.depth(f, np.array([[0.0, 0.0, 1.0]]))[0])
            if depth < 0.0:
                raise PlumblineError(
                    f"lesion {np.round(f, 4).tolist()} m lies outside of the body, not inside; "
                    "both are in CT coordinates, in m"
                )
        fields = {
            "chain": chain,
            "T_robot_ct": rigid(T_robot_ct, "T_robot_ct"),
            "lesion": f,
            "needle": needle,
            "body": body,
            "arm_radius": arm_radius,
            "scene": scene,
        }
        expect("arm_radius", arm_radius, Positive)
        expect("scene", scene, Scene | None)
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        far = float(np.linalg.norm(self.target))
        if far > constants.LARGEST:
            raise PlumblineError(
                f"lesion {far:.3g} m from the robot's base by T_robot_ct: at most "
                f"{constants.LARGEST:g} m; give both in metres, not mm"
            )
        self._check_scene()

    def _check_scene(self) -> None:
        """Refuse a lesion that no needle may be driven to."""
        if self.scene is None:
            return
        asked = [(solid, self.lesion) for solid in self.scene.anatomy]
        asked += [(solid, self.target) for solid in self.scene.room]
        for solid, point in asked:
            if not solid.enter and solid.holds(point):
                raise PlumblineError(
                    f"lesion {np.round(self.lesion, 4).tolist()} m lies inside of {solid.name}, "
                    "which the needle may not enter; say enter=True, or check its coordinates"
                )

    def __repr__(self) -> str:
        place = ", ".join(f"{1e3 * value:.1f}" for value in self.lesion)
        return f"<Aim of {self.chain.n} joints at ({place}) mm in CT>"

    @property
    def target(self) -> Array:
        """The lesion in robot coordinates (3,) [m]."""
        return self.T_robot_ct[:3, :3] @ self.lesion + self.T_robot_ct[:3, 3]

    def outward(self, theta: Array, beta: Array) -> Array:
        """Directions (N, 3) from the lesion to the needle, in robot coordinates."""
        return directions(theta, beta) @ self.T_robot_ct[:3, :3].T

    def rows(self, theta: Array, beta: Array) -> Array:
        """Data of the needle's task (N, 7): lesion [m], direction of the needle, l + r [m]."""
        count = len(theta)
        inward = -self.outward(theta, beta)
        return np.hstack(
            [np.tile(self.target, (count, 1)), inward, np.full((count, 1), self.needle.reach)]
        )

    def way_out(self, theta: Array, beta: Array) -> Array:
        """What of the body lies along each direction, from the lesion outwards (N,) [m]."""
        if self.body is None:
            return np.zeros(len(theta))
        return self.body.depth(self.lesion, directions(theta, beta))

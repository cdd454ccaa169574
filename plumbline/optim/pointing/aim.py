"""What a needle shall point at, with which arm, past which body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.kinematics.chain import Chain
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing.body import Body
from plumbline.optim.pointing.constants import LEAST_JOINTS
from plumbline.optim.pointing.given import array, number, rigid
from plumbline.optim.pointing.needle import Needle, directions
from plumbline.optim.pointing.scene import Scene
from plumbline.optim.recording import storing as storing  # a chain is stored as its joints


@dataclass(frozen=True, eq=False)
class Aim:
    """An arm with a needle, and the lesion that its tool centre point shall stay on.

    Attributes:
        chain: The arm, from its base to the flange that carries the needle.
        T_robot_ct: From CT to robot base coordinates (4, 4) [m].
        lesion: In CT coordinates (3,) [m].
        needle: Its length, stand-off and direction in the flange's frame.
        body: What the lesion lies in, the skin; None if the needle need not come into anything.
        arm_radius: Radius of the capsules that stand for the arm's links [m].
        scene: Organs, vessels and bones in CT, table and stands in the robot's frame. With neither
            body nor scene collisions do not matter; with either the needle must miss its own arm.
    """

    chain: Chain
    T_robot_ct: Array
    lesion: Array
    needle: Needle
    body: Body | None = None
    arm_radius: float = 0.045
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
                finite, lies outside of the body or inside of what the needle may not enter.
        """
        if chain.n < LEAST_JOINTS:
            raise PlumblineError(
                f"arm of {chain.n} joints: at least {LEAST_JOINTS} needed to hold a point and a "
                "direction; choose another arm or tip frame"
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
            "arm_radius": number(arm_radius, "arm_radius [m]", above=0.0),
            "scene": scene,
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        self._check_scene()

    def _check_scene(self) -> None:
        """Refuse a lesion that no needle may be driven to."""
        if self.scene is None:
            return
        if not isinstance(self.scene, Scene):
            raise PlumblineError(
                f"scene: {type(self.scene).__name__} found, Scene(anatomy, room) expected"
            )
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

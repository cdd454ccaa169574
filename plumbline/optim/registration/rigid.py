r"""The rigid least-squares fit (Kabsch 1976), with a scale if wanted (Umeyama 1991).

.. math:: \min_{R, t, s} \sum_i |q_i - s R p_i - t|^2

In closed form by an SVD; its derivatives by the markers are those of the minimum, by the implicit
function theorem on the symbolic statement.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from plumbline.optim.core.problem import Array
from plumbline.optim.registration.markers import MarkerNoise, Markers
from plumbline.optim.registration.method import Fit
from plumbline.optim.registration.statement import sensitivity
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True)
class Kabsch:
    """All markers weigh the same, along all axes.

    Attributes:
        scale: Also find the scale; rigid bodies have none, but a CT's pitch may be wrong.
    """

    scale: bool = False

    name: ClassVar[str] = "kabsch"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers."""
        T_RC = rigid_match(markers.ct, markers.robot, scale=self.scale)
        size = float(np.cbrt(np.linalg.det(T_RC[:3, :3])))
        centre = markers.robot.mean(axis=0)
        J = sensitivity(_alike(markers), T_RC, centre, scale=self.scale)
        return Fit(T_RC, centre, J, tuple(range(len(markers))), size)

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m]; noise changes nothing."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        return rigid_match(c, r, scale=self.scale)


def _alike(markers: Markers) -> Markers:
    """The markers as this method sees them: one covariance for all, in the robot's frame."""
    n = len(markers)
    one = np.broadcast_to(np.eye(3), (n, 3, 3))
    return replace(markers, ct_cov=np.zeros((n, 3, 3)), robot_cov=one)

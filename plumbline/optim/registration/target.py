r"""The predicted error of a target, and how a pose's error reaches it.

.. math:: \Sigma_f = K \Sigma_x K^T, \quad K = [\,I\quad {-[f_R - c]_\times}\,], \qquad
          e^T \Sigma_f^{-1} e \le \begin{cases} \chi^2_3 & \text{noise exactly known} \\
          3 F_{3,\nu} & \text{its size known from } \nu \text{ freedoms} \end{cases}

Where nothing at all was stated of the noise, the limit is the quantile of draws; see
:mod:`plumbline.optim.registration.unstated`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, fdtri

from plumbline.errors import fault
from plumbline.optim.core.problem import Array


@dataclass(frozen=True, eq=False)
class TargetError:
    """Predicted error of a target: where the transform puts it minus where it is."""

    ct: Array  # the target in CT (3,) [m]
    robot: Array  # where the transform puts it (3,) [m]
    covariance: Array  # of the error in frame R (3, 3) [m^2]
    mean: Array  # of the error in frame R (3,) [m]; zero to first order
    dof: float = np.inf  # freedoms that the size of the noise was known from; inf where it is exact
    unknown: str = ""  # why no region can be given; empty where one can
    # squared Mahalanobis distances of draws (N,), where no noise was stated
    distances: Array | None = None

    @property
    def rms(self) -> float:
        """Root of the expected square of the error's length [m]."""
        return float(np.sqrt(np.trace(self.covariance) + self.mean @ self.mean))

    def limit(self, share: float = 0.95) -> float:
        """Squared Mahalanobis distance that a share of all errors stays within; inf if unknown."""
        if self.unknown:
            return np.inf
        if self.distances is not None:
            return float(np.quantile(self.distances, share))
        if np.isinf(self.dof):
            return float(chdtri(3, 1.0 - share))
        return float(3.0 * fdtri(3, self.dof, share))

    def semi_axes(self, share: float = 0.95) -> Array:
        """Semi-axes (3,) of the ellipsoid that holds a share of all errors, longest first [m]."""
        variances = np.linalg.eigvalsh(self.covariance)[::-1]
        axes: Array = np.sqrt(self.limit(share) * np.maximum(variances, 0.0))
        return axes

    @property
    def reach(self) -> float:
        """Farthest end of the 95 % region from where the transform puts the target [m]."""
        return float(np.linalg.norm(self.mean) + self.semi_axes()[0])

    def holds(self, errors: ArrayLike, share: float = 0.95) -> Array:
        """Which of some errors (N, 3) [m] lie within that ellipsoid."""
        e = np.atleast_2d(np.asarray(errors, dtype=float)) - self.mean
        squared = np.einsum("ni,ni->n", e, np.linalg.solve(self.covariance, e.T).T)
        return squared <= self.limit(share)


def point_of(place: ArrayLike, where: str) -> Array:
    """A place (3,) in CT [m].

    Raises:
        PlumblineError: It is none.
    """
    point = np.asarray(place, dtype=float)
    if point.shape != (3,) or not np.isfinite(point).all():
        expected, mend = "three finite coordinates in CT, m", "mend the target"
        raise fault(where, f"{point.tolist()}", expected, mend)
    return point


def lever(arm: Array, unknowns: int = 6) -> Array:
    """Displacement (..., 3, k) of a point at an arm (..., 3) [m] from the centre, by the pose."""
    K = np.zeros((*arm.shape, unknowns))
    K[..., 0, 0] = K[..., 1, 1] = K[..., 2, 2] = 1.0
    x, y, z = arm[..., 0], arm[..., 1], arm[..., 2]
    K[..., 0, 4], K[..., 0, 5] = z, -y
    K[..., 1, 3], K[..., 1, 5] = -z, x
    K[..., 2, 3], K[..., 2, 4] = y, -x
    if unknowns == 7:
        K[..., :, 6] = arm
    return K


def arc(arm: Array, rotation_cov: Array) -> tuple[Array, Array]:
    """Mean (..., 3) and covariance (..., 3, 3) of ``w x (w x a) / 2`` at arms a (..., 3) [m].

    Args:
        arm: From the centre to the points.
        rotation_cov: Covariance of the normal rotation vector w (3, 3) [rad^2].
    """
    unit = np.eye(3)
    B = 0.5 * (
        unit[:, :, None] * arm[..., None, None, :] + unit[:, None, :] * arm[..., None, :, None]
    )
    B = B - unit * arm[..., :, None, None]
    BS = B @ rotation_cov
    mean = 0.5 * np.trace(BS, axis1=-2, axis2=-1)
    return mean, 0.5 * np.einsum("...kij,...lji->...kl", BS, BS)

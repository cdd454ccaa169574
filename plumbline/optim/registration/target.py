r"""The predicted error of a target, how a pose's error reaches it, and noise that was not stated.

.. math:: \Sigma_f = K \Sigma_x K^T, \quad K = [\,I\quad {-[f_R - c]_\times}\,], \qquad
          e^T \Sigma_f^{-1} e \le \begin{cases} \chi^2_3 & \text{noise exactly known} \\
          3 F_{3,\nu} & \text{its size known from } \nu \text{ freedoms} \end{cases}

Noise of which nothing was stated is found along each axis of CT from what the markers leave over,

.. math:: s_k = \frac{1}{\nu_k} \sum_i r_{ik}^2, \qquad \nu_k = \sum_i P_{ik,ik}, \qquad
          \Sigma_e = \sum_k s_k \Big(\sum_i J_{ik} J_{ik}^T + a_k a_k^T\Big)

r are the misfits of the plain rigid fit along CT's axes and P what it leaves of the noise; slices
make one axis of CT poorer than the others, so that each has a variance of its own. J are the
derivatives of the target's place by the markers, a_k is the k-th axis of CT in the robot's frame:
the target is read in CT with the same error as a marker. Which part of a misfit is CT's cannot be
told from markers alone; all of it is taken for CT's, so that the region is, if anything, too wide.
A turn moves a target along an arc, so where it is ill known the errors fill no ellipsoid: the limit
is longer by the ratio of two quantiles of the same drawn poses, of where the turn itself takes the
target and of where the first order does.

Variances of so few freedoms are uncertain themselves, and unlike ones have no F distribution: the
region's limit is then the quantile of :math:`e^T \Sigma_e^{-1} e` over draws in each of which the
variances are estimated anew (Beran 1987, Biometrika 74(3): prepivoting). For one variance alone
that is the F quantile of Hotelling.
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Self

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy.special import chdtri, fdtri

from plumbline.errors import fault
from plumbline.optim.core.judged import root_of
from plumbline.optim.core.problem import Array
from plumbline.optim.registration.constants import (
    DRAWS,
    FEWEST_UNSTATED,
    LEAST_FREEDOM,
    LEAST_SHARE,
    SMALLEST,
)
from plumbline.optim.registration.markers import Markers
from plumbline.optim.rigid import rigid_match


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
    # the same (N,) of drawn poses along the arc of their turn, and to first order
    bent: tuple[Array, Array] | None = None

    @property
    def foreseen(self) -> Self:
        """The same of errors to come where this is the true place: the arc as seen from there."""
        return replace(self, mean=-self.mean)

    @property
    def rms(self) -> float:
        """Root of the expected square of the error's length [m]."""
        return float(np.sqrt(np.trace(self.covariance) + self.mean @ self.mean))

    def limit(self, share: float = 0.95) -> float:
        """Squared Mahalanobis distance that a share of all errors stays within; inf if unknown."""
        if self.unknown:
            return np.inf
        if self.distances is not None:
            straight = float(np.quantile(self.distances, share))
        elif np.isinf(self.dof):
            straight = float(chdtri(3, 1.0 - share))
        else:
            straight = float(3.0 * fdtri(3, self.dof, share))
        longer = np.divide(*np.quantile(self.bent or np.ones((2, 1)), share, axis=1))
        return straight * float(longer)

    def semi_axes(self, share: float = 0.95) -> Array:
        """Semi-axes (3,) of the ellipsoid that holds a share of all errors, longest first [m]."""
        variances = np.linalg.eigvalsh(self.covariance)[::-1]
        return np.sqrt(self.limit(share) * np.maximum(variances, 0.0))

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
    """A place (3,) in CT [m], refused if it is none."""
    point = numbers_of(place, where)
    if point.shape != (3,) or not np.isfinite(point).all():
        expected, mend = "three finite coordinates in CT, m", "mend the target"
        raise fault(where, f"{point.tolist()}", expected, mend)
    return point


def numbers_of(places: ArrayLike, where: str) -> Array:
    """Places as numbers, refused if they are none, such as a label."""
    try:
        return np.asarray(places, dtype=float)
    except (TypeError, ValueError):
        mend = "give x, y and z, not a label"
        raise fault(where, f"{places!r}", "coordinates in CT, m", mend) from None


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
    """Mean (..., 3), covariance (..., 3, 3) of ``-w x (w x a) / 2`` at arms a (..., 3) [m]."""
    unit = np.eye(3)
    B = 0.5 * (
        unit[:, :, None] * arm[..., None, None, :] + unit[:, None, :] * arm[..., None, :, None]
    )
    B = B - unit * arm[..., :, None, None]
    BS = B @ rotation_cov
    mean = -0.5 * np.trace(BS, axis1=-2, axis2=-1)
    return mean, 0.5 * np.einsum("...kij,...lji->...kl", BS, BS)


def bent(arm: Array, pose: Array, own: Array) -> tuple[Array, Array]:
    """Squared distances (N,) of drawn errors at an arm (3,) [m]: along the arc, and to first order.

    ``pose`` is the pose's covariance (k, k), ``own`` that of the target's reading (3, 3) [m^2].
    """
    z, K, k = _normal(), lever(arm, len(pose)), len(pose)
    x = z[:, :k] @ root_of(pose)
    straight = x @ K.T + z[:, -3:] @ root_of(own)
    back = scipy.spatial.transform.Rotation.from_rotvec(-x[:, 3:6]).apply(arm)
    mean, more = arc(arm, pose[3:6, 3:6])
    flat = K @ pose @ K.T + own
    along = straight + (arm - back - np.cross(x[:, 3:6], arm)) - mean
    return _squares(along, flat + more), _squares(straight, flat)


@cache
def _normal() -> Array:
    """Normal numbers (N, 10) for every pose and reading: the same, so that answers repeat."""
    return np.random.default_rng(0).normal(size=(DRAWS, 10))


def _squares(errors: Array, covariance: Array) -> Array:
    inverse = np.linalg.pinv(covariance, hermitian=True)
    return np.einsum("ni,ni->n", errors @ inverse, errors)


@dataclass(frozen=True, eq=False)
class Unstated:
    """The noise of n markers along CT's axes, and what it does to a pose."""

    variances: Array  # of a misfit along each axis of CT (3,) [m^2]
    freedoms: Array  # that each is estimated from (3,)
    taken: Array  # orthonormal columns (3 n, 6): what the plain rigid fit takes out of the noise
    jacobian: Array  # derivative (k, n, 3) of the pose by the markers' places in CT
    unknown: str  # why it cannot be known; empty where it can

    @classmethod
    def of(cls, markers: Markers, jacobian: Array) -> Self:
        """From markers and the derivative (k, n, 6) of the pose by them."""
        # How shifts and turns move the markers, by coordinates.
        moves = lever(markers.ct - markers.ct.mean(axis=0)).reshape(-1, 6)
        basis = np.linalg.qr(moves)[0]
        freedoms = 1.0 * len(markers) - np.sum(basis.reshape(-1, 3, 6) ** 2, axis=(0, 2))
        T = rigid_match(markers.ct, markers.robot)
        left = (markers.robot - T[:3, 3]) @ T[:3, :3] - markers.ct
        found = np.sum(left**2, axis=0) / np.maximum(freedoms, LEAST_FREEDOM)
        least = max(LEAST_SHARE * found.max(), SMALLEST**2)
        return cls(np.maximum(found, least), freedoms, basis, jacobian[..., :3], _unknown(markers))

    @property
    def size(self) -> float:
        """Root mean square over the axes [m]."""
        return float(np.sqrt(self.variances.mean()))

    @property
    def covariance(self) -> Array:
        """Of the pose (k, k)."""
        return np.einsum("anc,c,bnc->ab", self.jacobian, self.variances, self.jacobian)

    @cached_property
    def _drawn(self) -> tuple[Array, Array, Array]:
        """Errors of the pose (N, k), variances estimated anew (N, 3), normal numbers (N, 3)."""
        rng = np.random.default_rng(0)
        count = self.jacobian.shape[1]
        noise = rng.normal(size=(DRAWS, count, 3)) * np.sqrt(self.variances)
        flat = noise.reshape(DRAWS, -1)
        left = (flat - (flat @ self.taken) @ self.taken.T).reshape(noise.shape)
        again = np.sum(left**2, axis=1) / np.maximum(self.freedoms, LEAST_FREEDOM)
        poses = flat @ self.jacobian.reshape(len(self.jacobian), -1).T
        return poses, np.maximum(again, SMALLEST**2), rng.normal(size=(DRAWS, 3))

    def distances(self, arm: Array, axes: Array, own: Array | None) -> Array:
        """Squared Mahalanobis distances (N,) of a target's drawn errors at an arm (3,) [m] in R.

        ``axes`` are CT's in R (3, 3), ``own`` 1 sigma of its reading (3,) [m]; None as markers.
        """
        poses, again, normal = self._drawn
        K = lever(arm, len(self.jacobian))
        J = np.einsum("ab,bnc->anc", K, self.jacobian)
        parts = np.einsum("anc,bnc->cab", J, J)
        std = np.sqrt(self.variances) if own is None else own
        errors = poses @ K.T + (normal * std) @ axes.T
        read = np.einsum("ac,bc->cab", axes, axes)
        fixed = np.zeros((3, 3)) if own is None else np.einsum("cab,c->ab", read, own**2)
        spread = np.einsum("dc,cab->dab", again, parts + read if own is None else parts) + fixed
        return np.einsum("da,da->d", errors, np.linalg.solve(spread, errors[..., None])[..., 0])


def _unknown(markers: Markers) -> str:
    """Why these markers cannot show the noise."""
    mend = "state the CT's resolution and the robot's std"
    if len(markers) < FEWEST_UNSTATED:
        return f"three markers cannot show how large the noise is: {mend}, or add markers"
    level = np.flatnonzero(np.ptp(markers.ct, axis=0) == 0.0)
    if len(level):
        axis = "xyz"[level[0]]
        return f"all markers lie at one {axis} of CT, in one slice of unknown thickness: {mend}"
    return ""

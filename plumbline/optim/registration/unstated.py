r"""Noise of which nothing was stated: along each axis of CT, from what the markers leave over.

.. math:: s_k = \frac{1}{\nu_k} \sum_i r_{ik}^2, \qquad \nu_k = \sum_i P_{ik,ik}, \qquad
          \Sigma_e = \sum_k s_k \Big(\sum_i J_{ik} J_{ik}^T + a_k a_k^T\Big)

r are the misfits of the plain rigid fit along CT's axes and P what it leaves of the noise; slices
make one axis of CT poorer than the others, so that each has a variance s_k of its own. J are the
derivatives of the target's place by the markers, a_k is the k-th axis of CT in the robot's frame:
the target is read in CT with the same error as a marker. Which part of a misfit is CT's and which
is the robot's cannot be told from markers alone; all of it is taken for CT's, so that the region
is, if anything, too wide, and holds a robot's own reading of the target.

Variances of so few freedoms are uncertain themselves, and unlike ones have no F distribution. The
region's limit is therefore the quantile of :math:`e^T \Sigma_e^{-1} e` over draws of markers and
target with the noise found, in each of which the variances are estimated anew (Beran 1987,
Biometrika 74(3): prepivoting). For one variance alone that is the F quantile of Hotelling.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.registration.constants import (
    DRAWS,
    FEWEST_UNSTATED,
    LEAST_FREEDOM,
    LEAST_SHARE,
    SMALLEST,
)
from plumbline.optim.registration.markers import Markers
from plumbline.optim.registration.target import lever
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True, eq=False)
class Unstated:
    """The noise of n markers along CT's axes, and what it does to a pose."""

    variances: Array  # of a misfit along each axis of CT (3,) [m^2]
    freedoms: Array  # that each is estimated from (3,)
    taken: Array  # orthonormal columns (3 n, 6): what the plain rigid fit takes out of the noise
    jacobian: Array  # derivative (k, n, 3) of the pose by the markers' places in CT
    unknown: str  # why it cannot be known; empty where it can

    @classmethod
    def of(cls, markers: Markers, jacobian: Array) -> Unstated:
        """From markers and the derivative (k, n, 6) of the pose by them."""
        basis = np.linalg.qr(_moves(markers.ct))[0]
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
        """Squared Mahalanobis distances (N,) of drawn errors at a target.

        Args:
            arm: From the pose's centre to the target, in frame R (3,) [m].
            axes: CT's axes in frame R (3, 3), by columns.
            own: Standard deviations of the target's own reading in CT (3,) [m]; None if it is
                read as the markers are.
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


def _moves(points: Array) -> Array:
    """How shifts and turns move points (n, 3), by coordinates (3 n, 6)."""
    moves: Array = lever(points - points.mean(axis=0)).reshape(-1, 6)
    return moves


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

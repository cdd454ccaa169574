r"""Three markers out of n: the best ones for a lesion, and all of them combined.

.. math:: \hat x = \Big(\sum_k P_k^{-1}\Big)^{-1} \sum_k P_k^{-1} x_k, \qquad
          P_k = J_k \Sigma J_k^T

Every triple, in every order that makes a different frame, is a three-point frame with a predicted
covariance. The best one has the least predicted TRE at the lesion; nothing of how well it fits
enters, since a good fit says nothing of the error there. The combination is the mean of all poses
in the tangent space at the mean, weighted by their inverse covariances, each pose being a
displacement at the markers' centre and a rotation vector; it is worked out anew about the mean
until that stays. Triples share markers, so these weights are not the best ones; the covariance of
the mean is nevertheless right to first order in the noise, because all derivatives are by the same
coordinates: :math:`J = (\sum P_k^{-1})^{-1} \sum P_k^{-1} J_k`, the weights held.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.registration.checks import smallest_angles, well_spread
from plumbline.optim.registration.constants import LEAST_ANGLE, MEAN_ROUNDS, STILL
from plumbline.optim.registration.least_squares import move
from plumbline.optim.registration.markers import MarkerNoise, Markers
from plumbline.optim.registration.method import Fit
from plumbline.optim.registration.target import lever
from plumbline.optim.registration.three_point import ThreePoint, sensitivities, three_point_batch

Triple = tuple[int, int, int]


def usable_triples(markers: Markers) -> NDArray[np.intp]:
    """Ordered triples (K, 3) that span a plane in both frames, of some well-spread markers."""
    triples = np.array(list(permutations(well_spread(markers.ct), 3)))
    angles = np.minimum(
        smallest_angles(markers.ct[triples]), smallest_angles(markers.robot[triples])
    )
    return triples[angles >= min(LEAST_ANGLE, float(angles.max()))]


@dataclass(frozen=True, eq=False)
class Frames:
    """Three-point frames of K triples."""

    triples: NDArray[np.intp]  # markers (K, 3) of each
    T_RC: Array  # their poses (K, 4, 4) [m]
    centres: Array  # where their derivatives are taken in frame R (K, 3) [m]
    jacobian: Array  # derivatives (K, 6, 3, 6) by the places of their own markers
    covariance: Array  # of the poses (K, 6, 6), at their centres

    @classmethod
    def of(cls, markers: Markers, triples: NDArray[np.intp], centre: Array | None = None) -> Frames:
        """All frames, their derivatives taken at one centre of frame R if it is given."""
        ct, robot = markers.ct[triples], markers.robot[triples]
        T, J = three_point_batch(ct, robot), sensitivities(ct, robot)
        places = (T[:, :3, :3] @ ct.mean(axis=1)[..., None])[..., 0] + T[:, :3, 3]
        if centre is not None:
            J[:, :3] += np.einsum("kab,kbnc->kanc", lever(centre - places)[..., 3:], J[:, 3:])
            places = np.broadcast_to(centre, places.shape)
        P = np.einsum("kanc,kncd,kbnd->kab", J, markers.covariance[triples], J, optimize=True)
        return cls(triples, T, places, J, P)

    def tre_squares(self, lesion: Array) -> Array:
        """Predicted mean square errors (K,) at a lesion in CT (3,), to first order [m^2]."""
        places = self.T_RC[:, :3, :3] @ lesion + self.T_RC[:, :3, 3]
        K = lever(places - self.centres)
        return np.einsum("kab,kbc,kac->k", K, self.covariance, K, optimize=True)


@dataclass(frozen=True)
class BestTriple:
    """The triple, and its order, with the least predicted TRE at a lesion."""

    # where, in CT (3,) [m]; at the markers' centre if not given
    lesion: tuple[float, float, float] | None = None

    name: ClassVar[str] = "best-triple"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` of that triple and its derivatives by the markers."""
        where = markers.ct.mean(axis=0) if self.lesion is None else np.array(self.lesion)
        frames = Frames.of(markers, usable_triples(markers))
        best = int(frames.tre_squares(where).argmin())
        a, b, c = (int(k) for k in frames.triples[best])
        jacobian = np.zeros((6, len(markers), 6))
        jacobian[:, [a, b, c]] = frames.jacobian[best]
        return Fit(frames.T_RC[best], frames.centres[best], jacobian, (a, b, c))

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], by the triple best on their mean."""
        mean = _mean_markers(ct, robot, noise)
        used = self.fit(mean).used
        return ThreePoint((used[0], used[1], used[2])).batch(ct, robot)


@dataclass(frozen=True)
class CombinedTriples:
    """The mean of all triples' poses, weighted by their inverse covariances."""

    name: ClassVar[str] = "combined"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers."""
        centre = markers.robot.mean(axis=0)
        frames = Frames.of(markers, usable_triples(markers), centre)
        G = _gains(frames.covariance)
        T = _mean(frames.T_RC[None], centre[None], G)[0]
        jacobian = np.zeros((len(markers), 6, 6))
        parts = np.einsum("kab,kbnc->knac", G, frames.jacobian, optimize=True)
        np.add.at(jacobian, frames.triples, parts)
        used = tuple(int(k) for k in np.unique(frames.triples))
        return Fit(T, centre, jacobian.transpose(1, 0, 2), used)

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], all with the weights of their mean."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        c, r, shape = c.reshape(-1, *c.shape[-2:]), r.reshape(-1, *r.shape[-2:]), c.shape[:-2]
        mean = _mean_markers(c, r, noise)
        frames = Frames.of(mean, usable_triples(mean), mean.robot.mean(axis=0))
        T = three_point_batch(c[:, frames.triples], r[:, frames.triples])
        return _mean(T, r.mean(axis=1), _gains(frames.covariance)).reshape(*shape, 4, 4)


def _mean_markers(ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None) -> Markers:
    """The mean of many draws (..., n, 3) of the same markers."""
    c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
    c, r = c.reshape(-1, *c.shape[-2:]), r.reshape(-1, *r.shape[-2:])
    return Markers.of(c.mean(axis=0), r.mean(axis=0), noise)


def _gains(P: Array) -> Array:
    """Weights (K, 6, 6) of K poses with covariances P (K, 6, 6); they add up to one."""
    # Lengths and angles differ by orders of magnitude: scaled, the inverse keeps its digits.
    size = np.sqrt(np.einsum("kaa->a", P))
    weights = np.linalg.inv(P / np.outer(size, size))
    gains = np.linalg.solve(weights.sum(axis=0), weights)
    return gains * (size[:, None] / size[None, :])


def _mean(T: Array, centre: Array, gains: Array) -> Array:
    """Weighted mean (N, 4, 4) of K poses (N, K, 4, 4) about centres of frame R (N, 3)."""
    mean = T[:, 0].copy()
    for _ in range(MEAN_ROUNDS):
        back = np.linalg.inv(mean)
        c = np.einsum("nij,nj->ni", back[:, :3, :3], centre) + back[:, :3, 3]
        image = (T[..., :3, :3] @ c[:, None, :, None])[..., 0]
        shift = image + T[..., :3, 3] - centre[:, None]
        turn = T[..., :3, :3] @ np.swapaxes(mean[:, None, :3, :3], -1, -2)
        away = np.concatenate([shift, _rotation_vector(turn)], axis=2)
        x = np.tensordot(away, gains, axes=([1, 2], [0, 2]))
        mean = move(mean, centre, x)
        if np.abs(x).max() <= STILL:
            break
    return mean


def _rotation_vector(R: Array) -> Array:
    """Rotation vectors (..., 3) [rad] of rotations (..., 3, 3) by less than half a turn."""
    pairs = ((2, 1), (0, 2), (1, 0))
    axis = np.stack([(R[..., i, j] - R[..., j, i]) / 2 for i, j in pairs], axis=-1)
    sine = np.linalg.norm(axis, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    factor = np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0)
    vector: Array = axis * factor[..., None]
    return vector

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

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from optim.faults import RegistrationError
from optim.problem import Array
from optim.registration.answer import Registers, Registration, lever
from optim.registration.condition import smallest_angles
from optim.registration.least_squares import move
from optim.registration.markers import Markers, Noise, refusal
from optim.registration.method import Fit
from optim.registration.three_point import ThreePoint, three_point_batch

Triple = tuple[int, int, int]
LEAST_ANGLE = 2.0  # [deg]: narrower triples add nothing to the mean
STILL = 1e-11  # [m and rad]
ROUNDS = 30


def orders_of(n: int) -> list[Triple]:
    """All ordered triples of n markers: the origin and the first axis depend on the order."""
    return [(i, j, k) for i, j, k in permutations(range(n), 3)]


def usable_triples(markers: Markers) -> list[Triple]:
    """Ordered triples that span a plane, in CT."""
    triples = orders_of(len(markers))
    angles = smallest_angles(markers.ct[np.array(triples)])
    least = min(LEAST_ANGLE, float(angles.max()))
    return [triple for triple, angle in zip(triples, angles, strict=True) if angle >= least]


def rank_triples(
    ct: ArrayLike,
    robot: ArrayLike,
    lesion: ArrayLike,
    noise: Noise | None = None,
    labels: Sequence[str] | None = None,
) -> tuple[Registration, ...]:
    """Every usable triple as a registration, in its best order, the best for the lesion first.

    Args:
        ct: Markers in CT (n, 3) [m].
        robot: The same by the robot (n, 3) [m].
        lesion: What the robot is to find, in CT (3,) [m].
        noise: How well markers were read.
        labels: Their names (n).

    Raises:
        RegistrationError: The markers cannot be registered, by no triple.
    """
    n = len(np.asarray(ct, dtype=float))
    found: dict[tuple[int, ...], tuple[float, Registration]] = {}
    refused: RegistrationError | None = None
    for triple in orders_of(n):
        try:
            answer = ThreePoint(triple)(ct, robot, noise, labels)
        except RegistrationError as error:
            refused = error
            continue
        rms, key = answer.tre(lesion).rms, tuple(sorted(triple))
        if key not in found or rms < found[key][0]:
            found[key] = rms, answer
    if not found:
        raise refused or refusal("markers", f"{n} of them", "at least 3", "add markers")
    return tuple(answer for _, answer in sorted(found.values(), key=lambda pair: pair[0]))


@dataclass(frozen=True)
class BestTriple(Registers):
    """The triple, and its order, with the least predicted TRE at a lesion.

    Attributes:
        lesion: Where, in CT (3,) [m]; at the markers' centre if not given.
    """

    lesion: tuple[float, float, float] | None = None

    name: ClassVar[str] = "best-triple"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` of that triple and its derivatives by the markers."""
        where = markers.ct.mean(axis=0) if self.lesion is None else np.array(self.lesion)
        fits = [ThreePoint(triple).fit(markers) for triple in usable_triples(markers)]
        return min(fits, key=lambda fit: _tre_square(fit, markers, where))

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: Noise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], by the triple best on their mean."""
        mean = _mean_markers(ct, robot, noise)
        used = self.fit(mean).used
        return ThreePoint((used[0], used[1], used[2])).batch(ct, robot)


@dataclass(frozen=True)
class CombinedTriples(Registers):
    """The mean of all triples' poses, weighted by their inverse covariances."""

    name: ClassVar[str] = "combined"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers."""
        triples = usable_triples(markers)
        centre = markers.robot.mean(axis=0)
        fits = [ThreePoint(triple).fit(markers) for triple in triples]
        J = np.stack([_carried(fit, centre) for fit in fits])
        G = _gains(J, markers)
        T = _mean(np.stack([fit.T_RC for fit in fits])[None], centre[None], G)[0]
        jacobian = np.einsum("kab,kbnc->anc", G, J)
        return Fit(T, centre, jacobian, tuple(range(len(markers))))

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: Noise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m], all with the weights of their mean."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        c, r, shape = c.reshape(-1, *c.shape[-2:]), r.reshape(-1, *r.shape[-2:]), c.shape[:-2]
        mean = _mean_markers(c, r, noise)
        triples = usable_triples(mean)
        centre = mean.robot.mean(axis=0)
        G = _gains(np.stack([_carried(ThreePoint(t).fit(mean), centre) for t in triples]), mean)
        T = np.stack([three_point_batch(c[:, t], r[:, t]) for t in map(list, triples)], axis=1)
        return _mean(T, r.mean(axis=1), G).reshape(*shape, 4, 4)


def _mean_markers(ct: ArrayLike, robot: ArrayLike, noise: Noise | None) -> Markers:
    """The mean of many draws (..., n, 3) of the same markers."""
    c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
    c, r = c.reshape(-1, *c.shape[-2:]), r.reshape(-1, *r.shape[-2:])
    return Markers.of(c.mean(axis=0), r.mean(axis=0), noise)


def _tre_square(fit: Fit, markers: Markers, lesion: Array) -> float:
    """Predicted mean square error at a lesion in CT (3,), to first order [m^2]."""
    place = fit.T_RC[:3, :3] @ lesion + fit.T_RC[:3, 3]
    J = np.einsum("ab,bnc->anc", lever(place - fit.centre), fit.jacobian)
    return float(np.einsum("anc,ncd,and->", J, markers.covariance, J))


def _carried(fit: Fit, centre: Array) -> Array:
    """A fit's derivatives (6, n, 6), taken at another centre of frame R (3,)."""
    K = np.eye(6)
    K[:3] = lever(centre - fit.centre)
    return np.einsum("ab,bnc->anc", K, fit.jacobian)


def _gains(J: Array, markers: Markers) -> Array:
    """Weights (K, 6, 6) of K poses with derivatives J (K, 6, n, 6); they add up to one."""
    P = np.einsum("kanc,ncd,kbnd->kab", J, markers.covariance, J)
    # Lengths and angles differ by orders of magnitude: scaled, the inverse keeps its digits.
    size = np.sqrt(np.einsum("kaa->a", P))
    weights = np.linalg.inv(P / np.outer(size, size))
    gains = np.linalg.solve(weights.sum(axis=0), weights)
    return gains * (size[:, None] / size[None, :])


def _mean(T: Array, centre: Array, gains: Array) -> Array:
    """Weighted mean (N, 4, 4) of K poses (N, K, 4, 4) about centres of frame R (N, 3)."""
    mean = T[:, 0].copy()
    for _ in range(ROUNDS):
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

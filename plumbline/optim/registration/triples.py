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

The frame that three markers span, once in CT and once by the robot; no Procrustes.

.. math:: e_1 = \frac{M_2 - M_1}{|M_2 - M_1|}, \quad
          e_3 = \frac{(M_2 - M_1) \times (M_3 - M_1)}{|\cdot|}, \quad e_2 = e_3 \times e_1

.. math:: R_{RC} = R_{RM} R_{CM}^T, \qquad f_R = R_{RC} (f_C - M_{1C}) + M_{1R}

(Chen Guangbiao et al., three-marker lesion localisation, eqs. 2-9, rebuilt.) The origin is the
first marker, the first axis points to the second, and the third gives the plane: their order
matters, and errors of a marker are not evened out by the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations
from typing import ClassVar, Self

import casadi as cs
import numpy as np
import scipy
from numpy.typing import ArrayLike

from plumbline.declared import Declared
from plumbline.errors import fault
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import Transform, unskew
from plumbline.optim.core.problem import Array, Indices
from plumbline.optim.registration import constants
from plumbline.optim.registration.checks import smallest_angles, well_spread
from plumbline.optim.registration.least_squares import Fit, move
from plumbline.optim.registration.markers import MarkerNoise, Markers
from plumbline.optim.registration.target import lever


def marker_frame(m1: cs.SX, m2: cs.SX, m3: cs.SX) -> cs.SX:
    """Axes ``[e1 e2 e3]`` (3, 3) of three markers (3,) [m]: ``R_CM`` in CT, ``R_RM`` in R."""
    along = m2 - m1
    normal = cs.cross(along, m3 - m1)
    e1, e3 = along / cs.norm_2(along), normal / cs.norm_2(normal)
    return cs.horzcat(e1, cs.cross(e3, e1), e3)


def three_point(ct: Sequence[cs.SX], robot: Sequence[cs.SX]) -> Transform:
    """``T_RC`` in symbols from three markers (3,) in CT and the same by the robot [m]."""
    R_CM, R_RM = marker_frame(*ct), marker_frame(*robot)
    R_RC = R_RM @ R_CM.T
    return Transform(R_RC, robot[0] - R_RC @ ct[0])


@lru_cache(maxsize=1)
def localisation() -> cs.Function:
    """``f_R`` (3,) and ``T_RC`` (4, 4) as a function of the 18 coordinates and the target ``f_C``.

    Inputs: ``ct`` (3, 3) and ``robot`` (3, 3), one column a marker, and ``target`` (3,) [m].
    """
    ct, robot, target = cs.SX.sym("ct", 3, 3), cs.SX.sym("robot", 3, 3), cs.SX.sym("target", 3)
    T_RC = three_point(cs.horzsplit(ct), cs.horzsplit(robot))
    matrix = cs.vertcat(cs.horzcat(T_RC.R, T_RC.t), cs.DM([[0, 0, 0, 1]]))
    names = ["ct", "robot", "target"], ["f_R", "T_RC"]
    outputs = [cs.densify(T_RC.point(target)), cs.densify(matrix)]
    return cs.Function("localisation", [ct, robot, target], outputs, *names)


@lru_cache(maxsize=1)
def _sensitivity_of_row() -> cs.Function:
    """Derivative (6, 18), transposed, of the image of the middle [m/m] and the turn [rad/m]."""
    row, R_RC_here = cs.SX.sym("row", 18), cs.SX.sym("R", 3, 3)
    middle = cs.SX.sym("middle", 3)
    ct, robot = (cs.reshape(part, 3, 3) for part in (row[:9], row[9:]))
    T_RC = three_point(cs.horzsplit(ct), cs.horzsplit(robot))
    moved = cs.vertcat(T_RC.point(middle), unskew(T_RC.R @ R_RC_here.T))
    here = [T_RC.R, cs.sum2(ct) / 3]
    (jacobian,) = cs.substitute([cs.jacobian(moved, row)], [R_RC_here, middle], here)
    return cs.Function("sensitivity_of_row", [row], [cs.densify(jacobian.T)], {"cse": True})


@lru_cache(maxsize=1)
def _pose_of_row() -> cs.Function:
    """``T_RC`` (4, 4), transposed, of a row (18,): three markers of CT, then of the robot."""
    row = cs.SX.sym("row", 18)
    ct, robot = (cs.reshape(part, 3, 3) for part in (row[:9], row[9:]))
    T_RC = three_point(cs.horzsplit(ct), cs.horzsplit(robot))
    matrix = cs.vertcat(cs.horzcat(T_RC.R, T_RC.t), cs.DM([[0, 0, 0, 1]]))
    return cs.Function("pose_of_row", [row], [cs.densify(matrix.T)], {"cse": True})


def three_point_batch(ct: Array, robot: Array) -> Array:
    """``T_RC`` (..., 4, 4) of triples (..., 3, 3) [m], one row a marker; NaN if on one line."""
    shape = np.broadcast_shapes(ct.shape, robot.shape)
    rows = _rows(np.broadcast_to(ct, shape), np.broadcast_to(robot, shape))
    return over_rows(_pose_of_row(), rows)[0].reshape(*shape[:-2], 4, 4)


def sensitivities(ct: Array, robot: Array) -> Array:
    """Derivatives (K, 6, 3, 6) of triples' poses (K, 3, 3), at their middles, CT first."""
    J = over_rows(_sensitivity_of_row(), _rows(ct, robot))[0].reshape(-1, 6, 2, 3, 3)
    return np.concatenate([J[:, :, 0], J[:, :, 1]], axis=-1)


def _rows(ct: Array, robot: Array) -> Array:
    """Rows (K, 18) of triples (..., 3, 3)."""
    return np.concatenate([ct.reshape(-1, 9), robot.reshape(-1, 9)], axis=1)


@dataclass(frozen=True)
class ThreePoint(Declared):
    """The three-point frame as a method."""

    #: which three markers (from 0), in the order M1, M2, M3; all others only check it
    triple: tuple[int, int, int] = (0, 1, 2)

    name: ClassVar[str] = "three-point"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` and its derivatives by the markers."""
        k = list(self.triple)
        if not set(k) <= set(range(len(markers))) or len(set(k)) != 3:
            mend = "name three different markers"
            raise fault("triple", f"{self.triple}", f"indices below {len(markers)}", mend)
        ct, robot = markers.ct[k], markers.robot[k]
        _check_plane(markers.select(k))
        T_RC, middle = three_point_batch(ct, robot), ct.mean(axis=0)
        jacobian = np.zeros((6, len(markers), 6))
        jacobian[:, k] = sensitivities(ct, robot)[0]
        return Fit(T_RC, T_RC[:3, :3] @ middle + T_RC[:3, 3], jacobian, tuple(k))

    def batch(self, ct: ArrayLike, robot: ArrayLike, noise: MarkerNoise | None = None) -> Array:
        """``T_RC`` (..., 4, 4) of markers (..., n, 3) [m]; noise changes nothing."""
        c, r = np.asarray(ct, dtype=float), np.asarray(robot, dtype=float)
        return three_point_batch(c[..., self.triple, :], r[..., self.triple, :])


def _check_plane(triple: Markers) -> None:
    """Refuse a triple that spans no plane, whatever the other markers do."""
    for what, points in (("ct", triple.ct), ("robot", triple.robot)):
        angle = float(smallest_angles(points))
        if angle < constants.ON_A_LINE:
            where = f"triple {', '.join(triple.labels)}, {what}"
            found, mend = f"one line within {angle:.2g} deg", "choose another triple"
            raise fault(where, found, f"at least {constants.ON_A_LINE:g} deg", mend)


Triple = tuple[int, int, int]


def usable_triples(markers: Markers) -> Indices:
    """Ordered triples (K, 3) that span a plane in both frames, of some well-spread markers."""
    triples = np.array(list(permutations(well_spread(markers.ct), 3)))
    angles = np.minimum(
        smallest_angles(markers.ct[triples]), smallest_angles(markers.robot[triples])
    )
    return triples[angles >= min(constants.LEAST_ANGLE, float(angles.max()))]


@dataclass(frozen=True, eq=False)
class TripleFrames:
    """Three-point frames of K triples."""

    triples: Indices  # markers (K, 3) of each
    T_RC: Array  # their poses (K, 4, 4) [m]
    centres: Array  # where their derivatives are taken in frame R (K, 3) [m]
    jacobian: Array  # derivatives (K, 6, 3, 6) by the places of their own markers
    covariance: Array  # of the poses (K, 6, 6), at their centres

    @classmethod
    def of(cls, markers: Markers, triples: Indices, centre: Array | None = None) -> Self:
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
class BestTriple(Declared):
    """The triple, and its order, with the least predicted TRE at a lesion."""

    # where, in CT (3,) [m]; at the markers' centre if not given
    lesion: tuple[float, float, float] | None = None

    name: ClassVar[str] = "best-triple"

    def fit(self, markers: Markers) -> Fit:
        """``T_RC`` of that triple and its derivatives by the markers."""
        where = markers.ct.mean(axis=0) if self.lesion is None else np.array(self.lesion)
        frames = TripleFrames.of(markers, usable_triples(markers))
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
        frames = TripleFrames.of(markers, usable_triples(markers), centre)
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
        frames = TripleFrames.of(mean, usable_triples(mean), mean.robot.mean(axis=0))
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
    for _ in range(constants.MEAN_ROUNDS):
        back = np.linalg.inv(mean)
        c = np.einsum("nij,nj->ni", back[:, :3, :3], centre) + back[:, :3, 3]
        image = (T[..., :3, :3] @ c[:, None, :, None])[..., 0]
        shift = image + T[..., :3, 3] - centre[:, None]
        turn = T[..., :3, :3] @ np.swapaxes(mean[:, None, :3, :3], -1, -2)
        away = np.concatenate([shift, _rotation_vector(turn)], axis=2)
        x = np.tensordot(away, gains, axes=([1, 2], [0, 2]))
        mean = move(mean, centre, x)
        if np.abs(x).max() <= constants.STILL:
            break
    return mean


def _rotation_vector(R: Array) -> Array:
    """Rotation vectors (..., 3) [rad] of rotations (..., 3, 3)."""
    found = scipy.spatial.transform.Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(found).reshape(R.shape[:-1])

r"""The registration of a scanned surface to one from CT, and motions that it does not show.

.. math:: \min_T \sum_i d(T p_i)^2, \qquad
          d(p) = \frac{\sum_j w_j\, n_j^T (p - q_j)}{\sum_j w_j}, \qquad
          w_j = \exp\Big(-\frac{|p - q_j|^2}{2 h^2}\Big)

with q_j the surface points around p, n_j their normals and h the distance between neighbours: the
distance from the surface that the points imply (Kolluri 2008, ACM Trans. Algorithms 4, sec. 2). It
is smooth, so that Gauss and Newton's steps, with the mean normal as its slope, come to rest;
matches with single nearest points go in circles, and their planes lie beside a curved surface.

A motion x moves each point along its normal by A x. On a ball, a pipe or a plane some motion moves
no point so; but normals from a few points of CT err, and what errs by chance looks like
information. Normals of every other point of the surface, and of the rest, err apart: with a and b
by either half,

.. math:: z = \frac{\sum_i a_i b_i}{\sqrt{\sum_i \big((a_i - b_i)^2 / 2\big)^2}}

is about zero for a motion that the surface does not show, with a variance of a third: for normal
errors of variance s the numerator has :math:`s^2` and the denominator :math:`3 s^2` a point.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Self

import numpy as np
import scipy

from plumbline.errors import PlumblineError
from plumbline.kinematics.frames import homogeneous
from plumbline.optim.core.judged import Judged, judged_by_gram
from plumbline.optim.core.mapped import Gram
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye import constants
from plumbline.optim.hand_eye.accuracy import moved
from plumbline.optim.hand_eye.readings import principal_plane
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """A scan laid on a surface."""

    T: Array  # from the scan's frame to the surface's (4, 4)
    distances: Array  # of the scanned points from the surface (N,) [m]
    normals: Array  # of the surface nearest to each point (N, 3), in its frame
    judged: Judged  # whether it rests there, by the sum that is minimised


@dataclass(frozen=True, eq=False)
class Surface:
    """Points of a surface that tell its normals and how far other points are from it."""

    points: Array  # the points (M, 3) [m]
    normals: Array  # unit normals there (M, 3), either way
    tree: scipy.spatial.KDTree  # what finds neighbours
    spacing: float  # median distance of a point from the nearest other one [m]

    @classmethod
    def of(cls, points: Array) -> Self:
        """From points (M, 3) [m], close together."""
        tree = scipy.spatial.KDTree(points)
        far, near = map(np.asarray, tree.query(points, min(constants.NEIGHBOURS, len(points))))
        around = points[near] - points[near].mean(axis=1, keepdims=True)
        normals = np.linalg.svd(around, full_matrices=False)[2][:, 2]
        return cls(points, normals, tree, float(np.median(far[:, 1])))

    def planes(self, points: Array) -> tuple[Array, Array]:
        """The surface points nearest to points (N, 3) [m], and the unit normals there (N, 3)."""
        index = self.tree.query(points)[1]
        return self.points[index], self.normals[index]

    def around(self, points: Array) -> tuple[Array, Array, Array]:
        """Distances d (N,) of points (N, 3) [m], mean normals (N, 3), the nearest point's (N,)."""
        few = min(constants.NEIGHBOURS, len(self.points))
        far, near = map(np.asarray, self.tree.query(points, few))
        n = self.normals[near]
        n = n * np.where(np.einsum("nkj,nj->nk", n, n[:, 0]) < 0.0, -1.0, 1.0)[:, :, None]
        w = np.exp(-(far**2 - far[:, :1] ** 2) / (2.0 * self.spacing**2))
        w = w / w.sum(axis=1, keepdims=True)
        gaps = points[:, None] - self.points[near]
        d = np.einsum("nk,nkj,nkj->n", w, n, gaps)
        return d, np.einsum("nk,nkj->nj", w, n), far[:, 0]


def face_angles(faces: list[Array]) -> Array:
    """Angles [rad], 0 to 90 deg, between the principal planes of faces (N, 3) [m], pair by pair."""
    planes = [principal_plane(points) for points in faces]
    return np.array([one.angle_to(two) for one, two in combinations(planes, 2)])


def register_surface(
    scan: Array, surface: Array, landmarks: tuple[Array, Array] | None = None
) -> SurfaceFit:
    """Lay a scan on a surface.

    Args:
        scan: Points (N, 3) [m].
        surface: Points of the surface (M, 3) [m], close together.
        landmarks: The same few points in both frames, (k, 3) each [m], for a start; none if the
            frames agree within a few mm already.

    Raises:
        PlumblineError: The scan does not find the surface.
    """
    target = Surface.of(surface)
    T = np.eye(4) if landmarks is None else rigid_match(*landmarks)
    for reach in (constants.FIRST_REACH, constants.LAST_REACH):
        T = _settled(T, scan, target, reach)
    d, normals, _ = target.around(moved(T, scan))
    units = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return SurfaceFit(T, np.abs(d), units, judge(moved(T, scan), target))


def _settled(T: Array, scan: Array, target: Surface, reach: float) -> Array:
    """Where Gauss and Newton's steps come to rest with the points that are within reach [m]."""
    for _ in range(constants.SURFACE_STEPS):
        points = moved(T, scan)
        J, d = _rows(points, target, reach)
        if len(d) < constants.LEAST_MATCHED * len(scan):
            raise PlumblineError(
                f"{len(d)} of {len(scan)} scanned points within {reach * 1e3:.0f} mm of "
                "the surface, half of them expected; give landmarks.csv, or better points in it"
            )
        step = _step(J, d)
        T = _moving(step, points.mean(axis=0)) @ T
        if np.abs(step).max() < constants.SURFACE_REST:
            break
    return T


def _step(J: Array, d: Array) -> Array:
    """A step (6,), turn [rad] and shift [m], that goes nowhere where the surface shows nothing."""
    H = J.T @ J
    size = np.sqrt(np.repeat([np.trace(H[:3, :3]), np.trace(H[3:, 3:])], 3))
    held = H / np.outer(size, size) + constants.SURFACE_DAMPING * np.eye(6)
    return np.linalg.solve(held, -(J.T @ d) / size) / size


def _rows(points: Array, target: Surface, reach: float) -> tuple[Array, Array]:
    """Slopes (k, 6) by a turn about the points' middle and a shift, and distances (k,) [m]."""
    d, normals, nearest = target.around(points)
    near = (np.abs(d) <= reach) & (nearest <= reach + constants.SURFACE_GAP * target.spacing)
    arm, n = points[near] - points.mean(axis=0), normals[near]
    return np.hstack([np.cross(arm, n), n]), d[near]


def _moving(step: Array, centre: Array) -> Array:
    """The motion (4, 4) of a turn [rad] about a point (3,) [m], then a shift [m]."""
    R = scipy.spatial.transform.Rotation.from_rotvec(step[:3]).as_matrix()
    return homogeneous(R, centre - R @ centre + step[3:])


def judge(points: Array, target: Surface) -> Judged:
    """Whether points (N, 3) [m] within the last reach of the surface rest on it."""
    J, d = _rows(points, target, constants.LAST_REACH)
    gram = Gram(J.T @ J, J.T @ d, float(d @ d), float(len(d)))
    return judged_by_gram(gram, "the fit to the surface")


def rows_of(points: Array, normals: Array) -> Array:
    """How unit turns about the middle of points (N, 3) [m], and shifts, move them (N, 6)."""
    return np.hstack([np.cross(points - points.mean(axis=0), normals), normals])


def open_motions(points: Array, fit: SurfaceFit, surface: Array) -> tuple[str, ...]:
    """Motions of a scan (N, 3) that the surface (M, 3) [m] does not show, in words."""
    R, reach = fit.T[:3, :3], np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    scale = np.repeat([1.0 / reach, 1.0], 3)  # so that a motion's six numbers are ways at the edge
    whole = rows_of(points, fit.normals @ R) * scale
    ways = np.linalg.svd(whole, full_matrices=False)[2]
    halves = []
    for part in (surface[::2], surface[1::2]):
        normals = Surface.of(part).planes(moved(fit.T, points))[1]
        towards = np.sign(np.sum(normals * fit.normals, axis=1, keepdims=True))
        halves.append(rows_of(points, towards * normals @ R) * scale @ ways.T)
    a, b = halves
    noise = np.maximum((a - b) ** 2 / 2.0, constants.FINEST_NORMAL**2)
    z = np.sum(a * b, axis=0) / np.sqrt(np.sum(noise**2, axis=0))
    left = ways[z < constants.SHOWN]
    # Any mixture of open motions is open: turns are told from slides.
    apart = np.linalg.svd(left[:, :3])[0].T @ left
    return tuple(_words(way) for way in apart)


def _words(motion: Array) -> str:
    """A motion (6,), the turn's way at the scan's edge and the middle's own, as an axis."""
    slides = float(np.linalg.norm(motion[:3])) < constants.SLIDE
    axis = motion[3:] if slides else motion[:3]
    axis = axis / np.linalg.norm(axis) * np.sign(axis[np.argmax(np.abs(axis))])
    return (
        f"{'a slide along' if slides else 'a turn about'} ({', '.join(f'{x:.2f}' for x in axis)})"
    )

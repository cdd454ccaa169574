r"""Scans: angles between faces, and the registration of a scanned surface to one from CT.

.. math:: \min_T \sum_i \big|n_i \circ (T p_i - q_i)\big|^2

with q_i the surface point nearest to T p_i and n_i its normal, by the library small_gicp (Koide
2024), which weighs each component of the gap by the normal's instead of summing them as the
point-to-plane distance of Chen and Medioni (1992) does.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from types import ModuleType

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.core.judged import Judged, judged_by_gram
from plumbline.optim.core.mapped import Gram
from plumbline.optim.hand_eye.accuracy import moved
from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.constants import FIRST_REACH, LAST_REACH, LEAST_MATCHED, NEIGHBOURS
from plumbline.optim.hand_eye.principal_plane import principal_plane
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """A scan laid on a surface.

    Attributes:
        T: From the scan's frame to the surface's (4, 4).
        distances: Of the scanned points from the surface (N,) [m].
        normals: Of the surface nearest to each point (N, 3), in its frame.
        judged: Whether it rests there, by the sum that is minimised.
    """

    T: Array
    distances: Array
    normals: Array
    judged: Judged


def face_angles(faces: list[Array]) -> Array:
    """Angles [rad], 0 to 90 deg, between the principal planes of faces, pair by pair.

    Args:
        faces: Points (N, 3) of each face [m].
    """
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
        PlumblineError: The library is not there, or the scan does not find the surface.
    """
    gicp = _library()
    start = np.eye(4) if landmarks is None else rigid_match(*landmarks)
    target, source = gicp.PointCloud(surface), gicp.PointCloud(scan)
    tree = gicp.KdTree(target, num_threads=1)
    gicp.estimate_normals_covariances(target, tree, NEIGHBOURS, 1)
    for reach in (FIRST_REACH, LAST_REACH):
        found = gicp.align(
            target, source, tree, start, registration_type="PLANE_ICP",
            max_correspondence_distance=reach, num_threads=1, max_iterations=60,
            rotation_epsilon=1e-6, translation_epsilon=1e-7,
        )  # fmt: skip
        if found.num_inliers < LEAST_MATCHED * len(scan):
            raise PlumblineError(
                f"{found.num_inliers} of {len(scan)} scanned points within {reach * 1e3:.0f} mm of "
                "the surface, half of them expected; give landmarks.csv, or better points in it"
            )
        start = np.asarray(found.T_target_source)
    points = moved(start, scan)
    nearest, normals = tangent_planes(points, surface)
    gaps = points - nearest
    distances = np.abs(np.sum(gaps * normals, axis=1))
    return SurfaceFit(start, distances, normals, judge(points, gaps, normals))


def judge(points: Array, gaps: Array, normals: Array) -> Judged:
    """Whether points (N, 3) within the last reach of the surface rest on it.

    Args:
        points: In the surface's frame [m].
        gaps: From the nearest points of the surface (N, 3) [m].
        normals: There (N, 3).
    """
    near = np.linalg.norm(gaps, axis=1) <= LAST_REACH
    n, arm = normals[near], points[near] - points[near].mean(axis=0)
    axes = np.eye(3)
    turned = n[:, :, None] * np.cross(arm[:, None], axes[None])  # of component j by the turn
    J = np.concatenate([turned, n[:, :, None] * axes], axis=2).reshape(-1, 6)
    e = (n * gaps[near]).ravel()
    gram = Gram(J.T @ J, J.T @ e, float(e @ e), float(len(e)))
    return judged_by_gram(gram, "the fit to the surface")


def tangent_planes(points: Array, surface: Array) -> tuple[Array, Array]:
    """The surface points nearest to points (N, 3) [m], and the unit normals there (N, 3)."""
    library = _library()
    target = library.PointCloud(surface)
    tree = library.KdTree(target, num_threads=1)
    library.estimate_normals_covariances(target, tree, NEIGHBOURS, 1)
    index, _ = tree.batch_nearest_neighbor_search(points)
    return target.points()[index, :3], target.normals()[index, :3]


def _library() -> ModuleType:
    try:
        import small_gicp
    except ImportError:
        raise PlumblineError(
            "small_gicp is not installed, and registers surfaces: pip install small_gicp"
        ) from None
    return small_gicp

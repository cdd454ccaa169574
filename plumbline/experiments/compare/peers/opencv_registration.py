"""Rigid registration by OpenCV: Umeyama's, ``estimateAffine3D`` with the rotation forced."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def version() -> str:
    """Of OpenCV."""
    return str(cv2.__version__)


def fit(given: Mapping[str, Array]) -> Array:
    """Registrations ``T_RC`` (M, 4, 4) of M phantoms."""
    found = np.tile(np.eye(4), (len(given["ct"]), 1, 1))
    for k, (ct, robot) in enumerate(zip(given["ct"], given["robot"], strict=True)):
        # The scale is left free by this call and then set aside.
        T, _ = cv2.estimateAffine3D(ct, robot, force_rotation=True)
        R = T[:, :3] / np.cbrt(np.linalg.det(T[:, :3]))
        found[k, :3, :3], found[k, :3, 3] = R, robot.mean(axis=0) - R @ ct.mean(axis=0)
    return found


def figures(given: Mapping[str, Array], found: Array) -> dict[str, float]:
    """Mean error at the target [mm]."""
    there = np.einsum("mij,mj->mi", found[:, :3, :3], given["target_ct"]) + found[:, :3, 3]
    return {"error": 1e3 * float(np.linalg.norm(there - given["target_robot"], axis=1).mean())}

"""Rigid registration by SciPy: the least squares of all markers alike."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def version() -> str:
    """Of SciPy."""
    return str(scipy.__version__)


def fit(given: Mapping[str, Array]) -> Array:
    """Registrations ``T_RC`` (M, 4, 4) of M phantoms."""
    found = np.tile(np.eye(4), (len(given["ct"]), 1, 1))
    for k, (ct, robot) in enumerate(zip(given["ct"], given["robot"], strict=True)):
        a, b = ct.mean(axis=0), robot.mean(axis=0)
        R = Rotation.align_vectors(robot - b, ct - a)[0].as_matrix()
        found[k, :3, :3], found[k, :3, 3] = R, b - R @ a
    return found


def figures(given: Mapping[str, Array], found: Array) -> dict[str, float]:
    """Mean error at the target [mm]."""
    there = np.einsum("mij,mj->mi", found[:, :3, :3], given["target_ct"]) + found[:, :3, 3]
    return {"error": 1e3 * float(np.linalg.norm(there - given["target_robot"], axis=1).mean())}

"""Our registration as it is by default: moved markers are found and left out."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version as version_of

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.registration import MarkerNoise, build_fiducials, register

Array = NDArray[np.float64]


def version() -> str:
    """Of plumbline."""
    return version_of("plumbline-robotics")


def fit(given: Mapping[str, Array]) -> Array:
    """Registrations ``T_RC`` (M, 4, 4) of M phantoms."""
    std = float(given["noise_std"])
    noise = MarkerNoise.from_std(std, std)
    found = []
    for ct, robot in zip(given["ct"], given["robot"], strict=True):
        recording = build_fiducials(ct, robot, noise=noise)
        found.append(register(recording).T_RC)
    return np.array(found)


def figures(given: Mapping[str, Array], found: Array) -> dict[str, float]:
    """Mean error at the target [mm]."""
    there = np.einsum("mij,mj->mi", found[:, :3, :3], given["target_ct"]) + found[:, :3, 3]
    return {"error": 1e3 * float(np.linalg.norm(there - given["target_robot"], axis=1).mean())}

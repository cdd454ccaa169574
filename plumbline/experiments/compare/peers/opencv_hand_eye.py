"""OpenCV's hand-eye: ``calibrateHandEye`` by Park and Martin."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
METHOD = cv2.CALIB_HAND_EYE_PARK


def version() -> str:
    """Of OpenCV."""
    return str(cv2.__version__)


def fit(given: Mapping[str, Array]) -> Array:
    """The tool in the flange ``T`` (M, 4, 4) [m] of M set-ups."""
    found = np.tile(np.eye(4), (len(given["flange"]), 1, 1))
    for k, (flange, seen) in enumerate(zip(given["flange"], given["seen"], strict=True)):
        back = np.linalg.inv(seen)  # the device as the tool "sees" it: the camera's role
        R, t = cv2.calibrateHandEye(
            list(flange[:, :3, :3]), list(flange[:, :3, 3]),
            list(back[:, :3, :3]), list(back[:, :3, 3]), method=METHOD,
        )  # fmt: skip
        found[k, :3, :3], found[k, :3, 3] = R, np.ravel(t)
    return found


def figures(given: Mapping[str, Array], found: Array) -> dict[str, float]:
    """Mean error of the tool's place [mm] and of its turn [mrad]."""
    apart = np.linalg.inv(given["tool"]) @ found
    angle = np.arccos(np.clip((np.trace(apart[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    place = np.linalg.norm(apart[:, :3, 3], axis=1)
    return {"error": 1e3 * float(place.mean()), "turn": 1e3 * float(angle.mean())}

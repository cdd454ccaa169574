"""OpenCV: Umeyama's registration with the rotation forced, and hand-eye by Park and Martin."""

from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PACKAGE = "opencv-python-headless"


def registration(given: Mapping[str, Array]) -> Array:
    """Registrations ``T_RC`` (M, 4, 4) of M phantoms."""
    found = np.tile(np.eye(4), (len(given["ct"]), 1, 1))
    for k, (ct, robot) in enumerate(zip(given["ct"], given["robot"], strict=True)):
        # The scale is left free by this call and then set aside.
        T, _ = cv2.estimateAffine3D(ct, robot, force_rotation=True)
        R = T[:, :3] / np.cbrt(np.linalg.det(T[:, :3]))
        found[k, :3, :3], found[k, :3, 3] = R, robot.mean(axis=0) - R @ ct.mean(axis=0)
    return found


def hand_eye(given: Mapping[str, Array]) -> Array:
    """The tool in the flange ``T`` (M, 4, 4) [m] of M set-ups."""
    found = np.tile(np.eye(4), (len(given["flange"]), 1, 1))
    for k, (flange, seen) in enumerate(zip(given["flange"], given["seen"], strict=True)):
        back = np.linalg.inv(seen)  # the device as the tool "sees" it: the camera's role
        R, t = cv2.calibrateHandEye(
            list(flange[:, :3, :3]), list(flange[:, :3, 3]),
            list(back[:, :3, :3]), list(back[:, :3, 3]), method=cv2.CALIB_HAND_EYE_PARK,
        )  # fmt: skip
        found[k, :3, :3], found[k, :3, 3] = R, np.ravel(t)
    return found

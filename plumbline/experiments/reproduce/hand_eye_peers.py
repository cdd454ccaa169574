r"""What the method is compared with: least squares by SciPy, and a camera's hand-eye by OpenCV.

The first is eq. 5 of Zeng et al. (2017) as one would type it: all readings alike, nothing robust,
derivatives by finite differences. The second is :math:`A_i X = X B_i` (Tsai and Lenz 1989, Park and
Martin 1994, ...) for a camera that sees a target from the same poses: another instrument, which
gives a sense of scale; ``pip install plumbline[camera]``.
"""

from typing import Literal

import numpy as np
import scipy

from plumbline.errors import PlumblineError
from plumbline.kinematics.frames import homogeneous
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye.direct import statement
from plumbline.optim.hand_eye.readings import Beam, Frames, Readings

SCALE = 0.1e-3  # [m]: beyond it they bend; finder and arm of the paper together
TOLERANCE = 1e-11  # of SciPy's cost, step and slope
Loss = Literal["linear", "cauchy"]
METHODS = ("tsai", "park", "horaud", "andreff", "daniilidis")


def scipy_direct(readings: Readings, start: Beam, loss: Loss = "linear") -> Beam:
    """Least squares on eq. 5 by SciPy's trust region and forward differences, from a beam."""
    frames = Frames.of(readings, start)
    index = frames.index(readings)
    at, count = frames.carried(readings), len(frames.c)

    def residuals(x: Array) -> Array:
        v = np.append(x[3:5], 1.0) / np.sqrt(1.0 + x[3:5] @ x[3:5])
        slopes = np.column_stack([x[5 : 5 + 2 * count].reshape(count, 2), np.ones(count)])
        normals = slopes / np.linalg.norm(slopes, axis=1, keepdims=True)
        points = Beam(x[:3], v).points(at.R, at.t, at.distance)
        return np.asarray(np.sum(normals[index] * points, axis=1) + x[5 + 2 * count :][index])

    scale, least = statement(count, 0).scale, TOLERANCE
    first = np.concatenate([frames.of_beam(start), np.zeros(3 * count)])
    found = scipy.optimize.least_squares(
        residuals, first, jac="2-point", x_scale=scale,
        ftol=least, xtol=least, gtol=least, loss=loss, f_scale=SCALE,
    )  # fmt: skip
    return frames.beam(found.x)


def opencv_hand_eye(T_base_flange: Array, T_camera_target: Array, method: str = "park") -> Array:
    """``T_flange_camera`` (4, 4) [m] by OpenCV's ``calibrateHandEye``, of poses (N, 4, 4) [m]."""
    if method not in METHODS:
        raise PlumblineError(f"method {method!r}: one of {', '.join(METHODS)} expected")
    try:
        import cv2
    except ImportError:
        raise PlumblineError(
            "OpenCV is not installed: pip install 'opencv-python-headless<5'"
        ) from None
    solve = getattr(cv2, "calibrateHandEye", None)
    if solve is None:
        raise PlumblineError(
            f"OpenCV {cv2.__version__} has no calibrateHandEye; install one below 5"
        )
    R, t = solve(
        list(T_base_flange[:, :3, :3]), list(T_base_flange[:, :3, 3]),
        list(T_camera_target[:, :3, :3]), list(T_camera_target[:, :3, 3]),
        method=getattr(cv2, f"CALIB_HAND_EYE_{method.upper()}"),
    )  # fmt: skip
    return homogeneous(R, t)

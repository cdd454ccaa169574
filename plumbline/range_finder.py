"""The parts of a range finder's calibration, which ``plumbline.hand_eye`` asks as one."""

from plumbline.optim.hand_eye.accuracy import moved, repeatability
from plumbline.optim.hand_eye.calibrate import Calibration, calibrate
from plumbline.optim.hand_eye.design import next_poses, point_std
from plumbline.optim.hand_eye.readings import Beam, Readings
from plumbline.optim.hand_eye.single_plane import closed_form, select
from plumbline.optim.hand_eye.surface import register_surface
from plumbline.optim.hand_eye.three_planes import Weights, solve_three_planes

__all__ = [
    "Beam",
    "Calibration",
    "Readings",
    "Weights",
    "calibrate",
    "closed_form",
    "moved",
    "next_poses",
    "point_std",
    "register_surface",
    "repeatability",
    "select",
    "solve_three_planes",
]

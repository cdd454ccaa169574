"""The parts of a range finder's calibration, which ``plumbline.hand_eye`` asks as one."""

from plumbline.optim.hand_eye.accuracy import moved as moved
from plumbline.optim.hand_eye.accuracy import repeatability as repeatability
from plumbline.optim.hand_eye.calibrate import Calibration as Calibration
from plumbline.optim.hand_eye.calibrate import calibrate as calibrate
from plumbline.optim.hand_eye.design import next_poses as next_poses
from plumbline.optim.hand_eye.design import point_std as point_std
from plumbline.optim.hand_eye.readings import Beam as Beam
from plumbline.optim.hand_eye.readings import Readings as Readings
from plumbline.optim.hand_eye.single_plane import closed_form as closed_form
from plumbline.optim.hand_eye.single_plane import select as select
from plumbline.optim.hand_eye.surface import register_surface as register_surface
from plumbline.optim.hand_eye.three_planes import Weights as Weights
from plumbline.optim.hand_eye.three_planes import solve_three_planes as solve_three_planes

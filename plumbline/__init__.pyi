from plumbline import effects as effects
from plumbline import figures as figures
from plumbline import range_finder as range_finder
from plumbline import reproduce as reproduce
from plumbline import simulate as simulate
from plumbline import solvers as solvers
from plumbline.errors import PlumblineError as PlumblineError
from plumbline.experiments.importing.files import import_files as import_files
from plumbline.experiments.report.effect_list import listed
from plumbline.experiments.report.writing import write_report as write_report
from plumbline.experiments.sources import example as example
from plumbline.experiments.sources import fetch as fetch
from plumbline.experiments.sources import list_sources as list_sources
from plumbline.experiments.sweep.sweep import sweep as sweep
from plumbline.kinematics.effects import EFFECTS as EFFECTS
from plumbline.kinematics.evaluate import over_rows as over_rows
from plumbline.kinematics.frames import Transform as Transform
from plumbline.kinematics.robot import Robot as Robot
from plumbline.kinematics.robot import bundled_names as bundled_names
from plumbline.optim import budget as budget
from plumbline.optim import capsule_mpc, dh_fit
from plumbline.optim import pointing as pointing
from plumbline.optim import registration as registration
from plumbline.optim.capsule_mpc import Planner as Planner
from plumbline.optim.dh_fit import DHOptions as DHOptions
from plumbline.optim.dh_fit import fit_dh as fit_dh
from plumbline.optim.diagnosis.answer import Diagnosis as Diagnosis
from plumbline.optim.diagnosis.calibrate.check import check_calibration as check_calibration
from plumbline.optim.diagnosis.findings import Verdict as Verdict
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis as MotionDiagnosis
from plumbline.optim.diagnosis.motion.recording import MotionRecording as MotionRecording
from plumbline.optim.diagnosis.motion.recording import build_motion as build_motion
from plumbline.optim.diagnosis.motion.tracking import build_tracking as build_tracking
from plumbline.optim.diagnosis.of_any_kind import diagnose as diagnose
from plumbline.optim.diagnosis.options import DiagnosisOptions as DiagnosisOptions
from plumbline.optim.hand_eye.answer import hand_eye as hand_eye
from plumbline.optim.hand_eye.calibrate import HandEyeOptions as HandEyeOptions
from plumbline.optim.hand_eye.scan import ScanOptions as ScanOptions
from plumbline.optim.hand_eye.scan import scan as scan
from plumbline.optim.loading import load as load
from plumbline.optim.model import Drives as Drives
from plumbline.optim.model import Model as Model
from plumbline.optim.model import apply
from plumbline.optim.model.export.exported import replay as replay
from plumbline.optim.pointing import Aim as Aim
from plumbline.optim.pointing import Box as Box
from plumbline.optim.pointing import Capsule as Capsule
from plumbline.optim.pointing import Cylinder as Cylinder
from plumbline.optim.pointing import HalfSpace as HalfSpace
from plumbline.optim.pointing import Mesh as Mesh
from plumbline.optim.pointing import Needle as Needle
from plumbline.optim.pointing import PointingOptions as PointingOptions
from plumbline.optim.pointing import Scene as Scene
from plumbline.optim.pointing import Solid as Solid
from plumbline.optim.pointing import Sphere as Sphere
from plumbline.optim.pointing import plan_sweep as plan_sweep
from plumbline.optim.pointing import safe_angle_map as safe_angle_map
from plumbline.optim.recording.building import build_recording as build_recording
from plumbline.optim.recording.recording import Recording as Recording
from plumbline.optim.recording.recording import Session as Session
from plumbline.optim.recording.session import build_session as build_session
from plumbline.optim.registration import Kabsch as Kabsch
from plumbline.optim.registration import MarkerNoise as MarkerNoise
from plumbline.optim.registration import RegistrationOptions as RegistrationOptions
from plumbline.optim.registration import ThreePoint as ThreePoint
from plumbline.optim.registration import build_fiducials as build_fiducials
from plumbline.optim.registration import register as register

apply_model = apply
dh = dh_fit
list_effects = listed
mpc = capsule_mpc
__version__: str

"""Where the gap between a robot and its model lies, what causes it, and how far it shrinks.

``import plumbline`` is all that a user needs: ``plumbline.diagnose("my-robot")`` asks a recording,
``register``, ``hand_eye``, ``fit_dh`` and ``plan_sweep`` ask the four methods. The parts of a
method stand behind one name: ``registration``, ``pointing``, ``range_finder``, ``dh``, ``mpc``,
``effects``, ``solvers``; what is made up in ``simulate``, published trials in ``reproduce``,
pictures in ``figures``. What is asked for is loaded on first use, so that ``import plumbline``
costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plumbline import effects, figures, range_finder, reproduce, simulate, solvers
    from plumbline.errors import PlumblineError
    from plumbline.experiments.importing.files import import_files
    from plumbline.experiments.report.effect_list import listed as list_effects
    from plumbline.experiments.report.writing import write_report
    from plumbline.experiments.sources import example, fetch, list_sources
    from plumbline.experiments.sweep.sweep import sweep
    from plumbline.kinematics.effects import EFFECTS
    from plumbline.kinematics.evaluate import over_rows
    from plumbline.kinematics.frames import Transform
    from plumbline.kinematics.robot import Robot, bundled_names
    from plumbline.optim import budget, pointing, registration
    from plumbline.optim import capsule_mpc as mpc
    from plumbline.optim import dh_fit as dh
    from plumbline.optim.capsule_mpc import Planner
    from plumbline.optim.dh_fit import DHOptions, fit_dh
    from plumbline.optim.diagnosis.answer import Diagnosis
    from plumbline.optim.diagnosis.calibrate.check import check_calibration
    from plumbline.optim.diagnosis.findings import Verdict
    from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
    from plumbline.optim.diagnosis.motion.recording import MotionRecording, build_motion
    from plumbline.optim.diagnosis.motion.tracking import build_tracking
    from plumbline.optim.diagnosis.of_any_kind import diagnose
    from plumbline.optim.diagnosis.options import DiagnosisOptions
    from plumbline.optim.hand_eye.answer import hand_eye
    from plumbline.optim.hand_eye.calibrate import HandEyeOptions
    from plumbline.optim.hand_eye.scan import ScanOptions, scan
    from plumbline.optim.loading import load
    from plumbline.optim.model import Drives, Model
    from plumbline.optim.model import apply as apply_model
    from plumbline.optim.model.export.replay import replay
    from plumbline.optim.pointing import (
        Aim,
        Box,
        Capsule,
        Cylinder,
        HalfSpace,
        Mesh,
        Needle,
        PointingOptions,
        Scene,
        Solid,
        Sphere,
        plan_sweep,
        safe_angle_map,
    )
    from plumbline.optim.recording.building import build_recording
    from plumbline.optim.recording.recording import Recording, Session
    from plumbline.optim.recording.session import build_session
    from plumbline.optim.registration import (
        Kabsch,
        MarkerNoise,
        RegistrationOptions,
        ThreePoint,
        build_fiducials,
        register,
    )

    __version__: str

__all__ = [
    "EFFECTS",
    "Aim",
    "Box",
    "Capsule",
    "Cylinder",
    "DHOptions",
    "Diagnosis",
    "DiagnosisOptions",
    "Drives",
    "HalfSpace",
    "HandEyeOptions",
    "Kabsch",
    "MarkerNoise",
    "Mesh",
    "Model",
    "MotionDiagnosis",
    "MotionRecording",
    "Needle",
    "Planner",
    "PlumblineError",
    "PointingOptions",
    "Recording",
    "RegistrationOptions",
    "Robot",
    "ScanOptions",
    "Scene",
    "Session",
    "Solid",
    "Sphere",
    "ThreePoint",
    "Transform",
    "Verdict",
    "__version__",
    "apply_model",
    "budget",
    "build_fiducials",
    "build_motion",
    "build_recording",
    "build_session",
    "build_tracking",
    "bundled_names",
    "check_calibration",
    "dh",
    "diagnose",
    "effects",
    "example",
    "fetch",
    "figures",
    "fit_dh",
    "hand_eye",
    "import_files",
    "list_effects",
    "list_sources",
    "load",
    "mpc",
    "over_rows",
    "plan_sweep",
    "pointing",
    "range_finder",
    "register",
    "registration",
    "replay",
    "reproduce",
    "safe_angle_map",
    "scan",
    "simulate",
    "solvers",
    "sweep",
    "write_report",
]

_HOME = {
    "Aim": "optim.pointing:Aim",
    "Box": "optim.pointing:Box",
    "Capsule": "optim.pointing:Capsule",
    "Cylinder": "optim.pointing:Cylinder",
    "DHOptions": "optim.dh_fit:DHOptions",
    "Diagnosis": "optim.diagnosis.answer:Diagnosis",
    "DiagnosisOptions": "optim.diagnosis.options:DiagnosisOptions",
    "Drives": "optim.model:Drives",
    "EFFECTS": "kinematics.effects:EFFECTS",
    "HalfSpace": "optim.pointing:HalfSpace",
    "HandEyeOptions": "optim.hand_eye.calibrate:HandEyeOptions",
    "Kabsch": "optim.registration:Kabsch",
    "MarkerNoise": "optim.registration:MarkerNoise",
    "Mesh": "optim.pointing:Mesh",
    "Model": "optim.model:Model",
    "MotionDiagnosis": "optim.diagnosis.motion.answer:MotionDiagnosis",
    "MotionRecording": "optim.diagnosis.motion.recording:MotionRecording",
    "Needle": "optim.pointing:Needle",
    "Planner": "optim.capsule_mpc:Planner",
    "PlumblineError": "errors:PlumblineError",
    "PointingOptions": "optim.pointing:PointingOptions",
    "Recording": "optim.recording.recording:Recording",
    "RegistrationOptions": "optim.registration:RegistrationOptions",
    "Robot": "kinematics.robot:Robot",
    "ScanOptions": "optim.hand_eye.scan:ScanOptions",
    "Scene": "optim.pointing:Scene",
    "Session": "optim.recording.recording:Session",
    "Solid": "optim.pointing:Solid",
    "Sphere": "optim.pointing:Sphere",
    "ThreePoint": "optim.registration:ThreePoint",
    "Transform": "kinematics.frames:Transform",
    "Verdict": "optim.diagnosis.findings:Verdict",
    "apply_model": "optim.model:apply",
    "budget": "optim.budget",
    "build_fiducials": "optim.registration:build_fiducials",
    "build_motion": "optim.diagnosis.motion.recording:build_motion",
    "build_tracking": "optim.diagnosis.motion.tracking:build_tracking",
    "build_recording": "optim.recording.building:build_recording",
    "build_session": "optim.recording.session:build_session",
    "bundled_names": "kinematics.robot:bundled_names",
    "check_calibration": "optim.diagnosis.calibrate.check:check_calibration",
    "dh": "optim.dh_fit",
    "diagnose": "optim.diagnosis.of_any_kind:diagnose",
    "effects": "effects",
    "example": "experiments.sources:example",
    "fetch": "experiments.sources:fetch",
    "figures": "figures",
    "fit_dh": "optim.dh_fit:fit_dh",
    "hand_eye": "optim.hand_eye.answer:hand_eye",
    "import_files": "experiments.importing.files:import_files",
    "list_effects": "experiments.report.effect_list:listed",
    "list_sources": "experiments.sources:list_sources",
    "load": "optim.loading:load",
    "mpc": "optim.capsule_mpc",
    "over_rows": "kinematics.evaluate:over_rows",
    "plan_sweep": "optim.pointing:plan_sweep",
    "pointing": "optim.pointing",
    "range_finder": "range_finder",
    "register": "optim.registration:register",
    "registration": "optim.registration",
    "replay": "optim.model.export.replay:replay",
    "reproduce": "reproduce",
    "safe_angle_map": "optim.pointing:safe_angle_map",
    "scan": "optim.hand_eye.scan:scan",
    "simulate": "simulate",
    "solvers": "solvers",
    "sweep": "experiments.sweep.sweep:sweep",
    "write_report": "experiments.report.writing:write_report",
}

# Who shows what a method answers with.
_SHOWN = import_module(f"{__name__}.pictures")
_SHOWN.CARDS.append(f"{__name__}.experiments.report.writing")
_SHOWN.DRAWN.append(f"{__name__}.experiments.report.drawn")


def __getattr__(name: str) -> Any:
    """Load what is asked for."""
    if name == "__version__":
        return _version()
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    place, _, attribute = _HOME[name].partition(":")
    module = import_module(f"{__name__}.{place}")
    return getattr(module, attribute) if attribute else module


def __dir__() -> list[str]:
    """What there is, loaded or not."""
    return sorted({*globals(), *__all__})


def _version() -> str:
    from importlib.metadata import version

    return version("plumbline-robotics")

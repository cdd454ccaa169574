"""A library of few effects: laws of the machinery need no more, and take half the time."""

from plumbline.kinematics.effects import EFFECTS
from plumbline.optim.diagnosis.options import DiagnosisOptions

NAMES = (
    "joint_offset", "joint_scale", "joint_compliance", "backlash", "transmission_ripple",
    "base_bump", "base_drift", "tool_slip", "sensor_scale", "link_geometry",
)  # fmt: skip
FEW_EFFECTS = DiagnosisOptions(library=tuple(e for e in EFFECTS if e.name in NAMES))

"""A library of few effects: laws of the machinery need no more, and take half the time."""

from plumbline.kinematics.effects import EFFECTS, REGISTRY
from plumbline.optim.diagnosis.options import DiagnosisOptions

NAMES = (
    "joint_offset", "joint_scale", "joint_compliance", "backlash", "transmission_ripple",
    "base_bump", "base_drift", "tool_slip", "sensor_scale", "link_geometry",
)  # fmt: skip


def few_and(*names: str, without: str = "") -> DiagnosisOptions:
    """The few, and others that a law is about or that could be taken for them, but for one."""
    kept = {*NAMES, *names} - {without}
    return DiagnosisOptions(library=tuple(e for e in EFFECTS if e.name in kept))


def only(*names: str) -> DiagnosisOptions:
    """A library of what a law is about and what could be taken for it, and no more."""
    return DiagnosisOptions(library=tuple(REGISTRY[name] for name in names))


FEW_EFFECTS = few_and()

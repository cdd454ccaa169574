"""Pictures beyond an answer's own ``plot()``, by method; ``show`` puts one on white paper."""

from plumbline.experiments.report.dh_fit import pictures as dh
from plumbline.experiments.report.diagnosis.pictures import of_diagnosis
from plumbline.experiments.report.diagnosis.turned import turned as scene
from plumbline.experiments.report.hand_eye import pictures as hand_eye
from plumbline.experiments.report.mpc import motion
from plumbline.experiments.report.pointing import anatomy
from plumbline.experiments.report.pointing import figures as pointing
from plumbline.experiments.report.registration import figures as registration
from plumbline.experiments.report.reproduction import compared
from plumbline.experiments.report.style import on_paper as show

__all__ = [
    "anatomy",
    "compared",
    "dh",
    "hand_eye",
    "motion",
    "of_diagnosis",
    "pointing",
    "registration",
    "scene",
    "show",
]

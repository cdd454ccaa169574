"""The pictures of every answer by their names, undrawn: what ``answer.plot("joints")`` draws.

The first is what ``answer.plot()`` draws; one for which the data have nothing gives None.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

from plumbline.experiments.report.budget.page import waterfall
from plumbline.experiments.report.dh_fit.pictures import correlations, rows_picture
from plumbline.experiments.report.diagnosis.causes import staircase
from plumbline.experiments.report.diagnosis.motion import MAKERS as OF_A_MOTION
from plumbline.experiments.report.diagnosis.pictures import MAKERS
from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.experiments.report.diagnosis.turned import turned
from plumbline.experiments.report.hand_eye.pictures import bows, residuals
from plumbline.experiments.report.hand_eye.scan import scan_picture
from plumbline.experiments.report.pointing.figures import angle_map, joint_path
from plumbline.experiments.report.registration.figures import misfits_and_targets
from plumbline.optim.diagnosis.answer import Diagnosis

Drawers: TypeAlias = Mapping[str, Callable[[], Any]]


def of_diagnosis(answer: Diagnosis) -> Drawers:
    """Those of its report, and the scene that turns."""
    return _made(MAKERS, Subject.of(answer)) | {"scene": partial(turned, answer)}


def _made(makers: tuple[Callable[[Any], Any], ...], of: Any) -> dict[str, Callable[[], Any]]:
    return {make.__name__.removeprefix("_"): partial(make, of) for make in makers}


DRAWN: dict[str, Callable[[Any], Drawers]] = {
    "AngleMap": lambda a: {"angles": partial(angle_map, a)},
    "Budget": lambda a: {"waterfall": partial(waterfall, a)},
    "DHFit": lambda a: {"correlations": partial(correlations, a), "rows": partial(rows_picture, a)},
    "Diagnosis": of_diagnosis,
    "HandEye": lambda a: {k.__name__: partial(k, a.calibration) for k in (residuals, bows)},
    "MotionDiagnosis": partial(_made, OF_A_MOTION),
    "Registration": lambda a: {"misfits": partial(misfits_and_targets, a)},
    "ScanAnswer": lambda a: {"scan": partial(scan_picture, a)},
    "Sweep": lambda a: {"joints": partial(joint_path, a)},
    "Verdict": lambda a: {"staircase": partial(staircase, a)},
}

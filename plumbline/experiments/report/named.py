"""The pictures of an answer by their names: what ``answer.plot("joints")`` draws."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

from plumbline.experiments.report.dh_fit import pictures as dh
from plumbline.experiments.report.diagnosis.motion import MAKERS as OF_A_MOTION
from plumbline.experiments.report.diagnosis.pictures import MAKERS
from plumbline.experiments.report.diagnosis.subject import Diagnosed, Subject
from plumbline.experiments.report.diagnosis.turned import turned
from plumbline.experiments.report.hand_eye import pictures as hand_eye
from plumbline.experiments.report.registration.figures import misfits_and_targets
from plumbline.optim.dh_fit import DHFit
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.hand_eye.answer import HandEye
from plumbline.optim.registration import Registration

Drawers: TypeAlias = Mapping[str, Callable[[], Any]]


def of_diagnosis(answer: Diagnosed) -> Drawers:
    """Those of its report; one for which the recording has nothing gives None."""
    subject = Subject.of(answer)
    drawn = {make.__name__.removeprefix("_"): partial(make, subject) for make in MAKERS}
    return {**drawn, "scene": partial(turned, answer)}


def of_motion(answer: MotionDiagnosis) -> Drawers:
    """Traces of the joints with the largest gap, and what its report has besides."""
    return {make.__name__.removeprefix("_"): partial(make, answer) for make in OF_A_MOTION}


def of_registration(answer: Registration) -> Drawers:
    """Misfits of markers, errors of targets."""
    return {"misfits": partial(misfits_and_targets, answer)}


def of_hand_eye(answer: HandEye) -> Drawers:
    """What is left over, and where boards stand out of their planes."""
    fit = answer.calibration
    return {
        "residuals": partial(hand_eye.residuals, fit), "bows": partial(hand_eye.bows, fit),
    }  # fmt: skip


def of_dh_fit(answer: DHFit) -> Drawers:
    """Correlations of estimates, and the misfit of every row."""
    return {
        "correlations": partial(dh.correlations, answer), "rows": partial(dh.rows_picture, answer),
    }  # fmt: skip

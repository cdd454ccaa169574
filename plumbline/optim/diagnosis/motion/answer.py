"""What the diagnosis of a motion answers with: the verdict and what it rests on, joint by joint."""

from dataclasses import dataclass
from typing import Any

from plumbline.kinematics.effects import MotionEffect
from plumbline.optim.core.answer import parts_of, register, restored, restored_parts
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.motion.carrying import MassFindings
from plumbline.optim.diagnosis.motion.fit import JointFit, evaluated
from plumbline.optim.diagnosis.motion.left_out import LeftOut
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.motion.signals import Signals, signals_of
from plumbline.optim.diagnosis.motion.windows import Array
from plumbline.optim.diagnosis.motion.windows import Drives as Felt
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.with_verdict import WithVerdict
from plumbline.optim.model.drives import Drives, drives_of
from plumbline.optim.recording import storing as storing


@dataclass(frozen=True, eq=False, repr=False)
class MotionDiagnosis(WithVerdict):
    """A verdict on a motion with what it rests on.

    Attributes:
        recording: The data.
        verdict: What was found; its fields that are asked for most are this object's as well.
        signals: The data on an even clock.
        joints: What was found at each joint that moved.
        left_out: How that does on what was left out, joint by joint.
        options: How it was asked for.
        mass: What was found of a mass that the tip carries; None if none is.
    """

    recording: MotionRecording
    verdict: Verdict
    signals: Signals
    joints: tuple[JointFindings, ...]
    left_out: tuple[LeftOut, ...]
    options: DiagnosisOptions
    mass: MassFindings | None = None

    @property
    def fits(self) -> dict[int, JointFit]:
        """Effects with their values by joint, from 1."""
        return {joint.number: joint.fit for joint in self.joints}

    def model(self) -> Drives:
        """What was found, to take home: what other commands do, and a file for MuJoCo."""
        return drives_of(self.signals, self.joints, self.gap, self.mass)

    def transfer(self, other: MotionRecording) -> tuple[Array, Array]:
        """Root mean squares (n,) on another recording, ideal and with the causes: nothing refitted.

        Raises:
            PlumblineError: It is another kind of command, or of another number of joints.
        """
        return self.model().gaps(other)


def _of_joint(j: JointFindings) -> dict[str, Any]:
    return parts_of(j, "windows", "fit") | {"effects": j.fit.effects, "theta": j.fit.theta}


def _joint(data: Any, signals: Signals) -> JointFindings:
    """A joint whose windows are cut again, and whose drive is rolled out again."""
    given = restored_parts(data, JointFindings)
    effects = restored(data["effects"], tuple[MotionEffect, ...])
    windows = signals.windows(given["number"] - 1, signals.training)
    fit = evaluated(windows, effects, restored(data["theta"], Array))
    return JointFindings(windows=windows, fit=fit, **given)


def _taken(d: MotionDiagnosis) -> dict[str, Any]:
    """What is stored of a diagnosis; its even clock is made again."""
    own = parts_of(d, "signals", "options")
    own |= {"joints": list(map(_of_joint, d.joints)), "drives": d.signals.drives}
    return own | {"asked": d.options}


def _again(data: Any) -> MotionDiagnosis:
    given = restored_parts(data, MotionDiagnosis, "joints")
    drives = restored(data.get("drives", []), Felt)
    signals = signals_of(given["recording"], drives=drives)
    joints = tuple(_joint(one, signals) for one in data["joints"])
    asked = restored(data["asked"], DiagnosisOptions)
    return MotionDiagnosis(**given, signals=signals, joints=joints, options=asked)


register(MotionDiagnosis, _taken, _again)

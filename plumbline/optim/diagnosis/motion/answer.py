"""What the diagnosis of a motion answers with: the verdict and what it rests on, joint by joint."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

from plumbline.errors import PlumblineError, best_matches, shown
from plumbline.kinematics.effects import MOTION_EFFECTS, MotionEffect
from plumbline.optim.core.stored import register, restored
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.motion.fit import JointFit, evaluated
from plumbline.optim.diagnosis.motion.left_out import LeftOut
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.rollout import Array
from plumbline.optim.diagnosis.motion.search import Joint
from plumbline.optim.diagnosis.motion.signals import Signals, signals_of
from plumbline.optim.diagnosis.motion.unlisted import UnlistedFunction
from plumbline.optim.diagnosis.options import DiagnosisOptions, StoredOptions
from plumbline.optim.diagnosis.with_verdict import WithVerdict
from plumbline.optim.model.drives import Drives
from plumbline.optim.model.making_drives import drives_of
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
    """

    recording: MotionRecording
    verdict: Verdict
    signals: Signals
    joints: tuple[Joint, ...]
    left_out: tuple[LeftOut, ...]
    options: DiagnosisOptions

    @property
    def fits(self) -> dict[int, JointFit]:
        """Effects with their values by joint, from 1."""
        return {joint.number: joint.fit for joint in self.joints}

    def model(self) -> Drives:
        """What was found, to take home: what other commands do, and a file for MuJoCo."""
        return drives_of(self.signals, self.joints, self.gap)

    def transfer(self, other: MotionRecording) -> tuple[Array, Array]:
        """Root mean squares (n,) on another recording, ideal and with the causes: nothing refitted.

        Raises:
            PlumblineError: It is another kind of command, or of another number of joints.
        """
        return self.model().gaps(other)


@dataclass(frozen=True)
class _StoredEffect:
    """An effect's name, and the fields that tell its forms apart."""

    name: str
    fields: dict[str, Any]

    @property
    def effect(self) -> MotionEffect:
        known = {effect.name: effect for effect in MOTION_EFFECTS}
        if self.name not in known:
            raise PlumblineError(
                f"effect {shown(self.name)} not recognised, one of a motion's expected "
                f"(best matches: {best_matches(self.name, known)}); diagnose the recording again"
            )
        return restored(self.fields, known[self.name])


@dataclass(frozen=True, eq=False)
class _StoredJoint:
    """What is stored of a joint; its windows are cut again, and its drive rolled out again."""

    effects: tuple[_StoredEffect, ...]
    theta: Array
    number: int
    probability: dict[str, float]
    instead: dict[str, dict[str, float]]
    unlisted: tuple[UnlistedFunction, ...]
    outside: float
    mechanisms: dict[str, float]
    anything: float
    effective: float
    unseen: dict[str, float]
    std: Array

    @classmethod
    def of(cls, j: Joint) -> _StoredJoint:
        effects = tuple(_StoredEffect(e.name, asdict(e)) for e in j.fit.effects)
        return cls(effects=effects, theta=j.fit.theta, **cls._as_they_are(j))

    @classmethod
    def _as_they_are(cls, joint: Joint | _StoredJoint) -> dict[str, Any]:
        return {f.name: getattr(joint, f.name) for f in fields(cls)[2:]}

    def again(self, signals: Signals) -> Joint:
        windows = signals.windows(self.number - 1, signals.training)
        fit = evaluated(windows, tuple(one.effect for one in self.effects), self.theta)
        return Joint(windows=windows, fit=fit, **self._as_they_are(self))


@dataclass(frozen=True, eq=False)
class _Stored:
    """What is stored of a diagnosis; its even clock is made again."""

    recording: MotionRecording
    verdict: Verdict
    joints: tuple[_StoredJoint, ...]
    left_out: tuple[LeftOut, ...]
    asked: StoredOptions

    @classmethod
    def of(cls, d: MotionDiagnosis) -> _Stored:
        joints = tuple(_StoredJoint.of(joint) for joint in d.joints)
        return cls(d.recording, d.verdict, joints, d.left_out, StoredOptions.of(d.options))

    @classmethod
    def again(cls, data: Any) -> MotionDiagnosis:
        s = restored(data, cls)
        signals = signals_of(s.recording)
        joints = tuple(one.again(signals) for one in s.joints)
        return MotionDiagnosis(s.recording, s.verdict, signals, joints, s.left_out, s.asked.options)


register(MotionDiagnosis, _Stored.of, _Stored.again)

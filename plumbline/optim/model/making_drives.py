"""Drives from the diagnosis of a motion."""

from collections.abc import Sequence

import numpy as np

from plumbline.optim.diagnosis.findings import Gap
from plumbline.optim.diagnosis.motion.search import Joint
from plumbline.optim.diagnosis.motion.signals import Signals
from plumbline.optim.model.driven import Servo
from plumbline.optim.model.drives import Drives


def drives_of(signals: Signals, joints: Sequence[Joint], gap: Gap) -> Drives:
    """What a diagnosis found of every joint that moved."""
    r = signals.recording
    _, inertia = signals.loads
    servos = {}
    for joint in joints:
        at = joint.number - 1
        span = np.array([signals.command[:, at].min(), signals.command[:, at].max()])
        fit = joint.fit
        servos[joint.number] = Servo(
            fit.effects, fit.theta.copy(), joint.std, float(inertia[:, at].max()), span
        )
    return Drives(
        r.name, r.robot, r.joints, r.index, r.law, r.kp, r.kd, servos,
        gap.before, gap.after,
    )  # fmt: skip

"""The diagnosis of a motion: what each joint's drive does to its commands, and what is left."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.drive import Law
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.constants import SEARCH_SAMPLES, SEARCHED
from plumbline.optim.diagnosis.motion.left_out import left_out
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.search import prior_at, search
from plumbline.optim.diagnosis.motion.signals import signals_of, spread
from plumbline.optim.diagnosis.motion.tracking import load_drives
from plumbline.optim.diagnosis.motion.verdict import Found, verdict_of
from plumbline.optim.diagnosis.options import DiagnosisOptions

STILL = 1e-6  # [rad] a command and an encoder that move less tell nothing of a drive


def diagnose_motion(
    recording: MotionRecording | str | Path,
    options: DiagnosisOptions | None = None,
    *,
    progress: Callable[[str, float], None] | None = None,
) -> MotionDiagnosis:
    """Say what each joint's drive does to its commands.

    Args:
        recording: What was recorded, or the folder of it.
        options: Seed of the interval's draws, effects to leave out, prior of what is unlisted.
        progress: Called with what is being done and the share done.

    Raises:
        PlumblineError: The folder cannot be used, or no run is as long as a window.
    """
    options = options or DiagnosisOptions()
    r = recording if isinstance(recording, MotionRecording) else load_drives(recording)
    signals = signals_of(r)
    masses = signals.has_masses
    kinds = [e for e in MOTION_EFFECTS if e.name not in options.without]
    effects = tuple(e for c in kinds for e in c.candidates(r.law, masses=masses))
    training = signals.training
    if not len(training):
        raise PlumblineError(
            f"{r.name}: no run is as long as a window of {signals.length * signals.dt:.3g} s; "
            "hold fewer rows out, or record for longer"
        )
    moved = [j for j in range(r.n) if np.ptp(r.command[:, j]) + np.ptp(r.q[:, j]) > STILL]
    prior = prior_at(options.unlisted, len(moved))
    coarse = signals_of(r, SEARCH_SAMPLES) if r.law == Law.POSITION else signals
    looked_at = spread(coarse.training, SEARCHED * coarse.most)
    joints, unseen = [], []
    for k, j in enumerate(moved):
        if progress is not None:
            progress(f"{r.noun} {j + 1}", k / len(moved))
        windows = signals.windows(j, training)
        few = coarse.windows(j, looked_at)
        joint = search(j + 1, windows, few, effects, signals.seen(j), prior, signals.sigma)
        joints.append(joint)
        unseen.append(left_out(signals, joint))
    still = [j + 1 for j in range(r.n) if j not in moved]
    found = Found(
        r, joints, unseen, still, signals.held_out_by, options.seed, options.unlisted,
        signals.averaged,
    )  # fmt: skip
    return MotionDiagnosis(r, verdict_of(found), signals, tuple(joints), tuple(unseen), options)

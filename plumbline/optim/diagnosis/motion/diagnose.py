"""The diagnosis of a motion: what each joint's drive does to its commands, and what is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import MOTION_EFFECTS, MotionEffect
from plumbline.optim.core.judged import Judgement
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.motion.constants import MOST_JUDGED, UNLISTED
from plumbline.optim.diagnosis.motion.fit import Fit, evaluated
from plumbline.optim.diagnosis.motion.left_out import LeftOut, left_out
from plumbline.optim.diagnosis.motion.recording import MotionRecording, load_motion
from plumbline.optim.diagnosis.motion.rollout import Array
from plumbline.optim.diagnosis.motion.search import Joint, search
from plumbline.optim.diagnosis.motion.signals import Signals, signals_of, spread
from plumbline.optim.diagnosis.motion.verdict import Found, by_joint, verdict_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STILL = 1e-6  # [rad] a command and an encoder that move less tell nothing of a drive


@dataclass(frozen=True, eq=False)
class MotionDiagnosis:
    """A verdict on a motion with what it rests on.

    Attributes:
        recording: The data.
        verdict: What was found.
        signals: The data on an even clock.
        joints: What was found at each joint that moved.
        judged: How that does on what was left out, joint by joint.
        seed: What it was drawn with.
    """

    recording: MotionRecording
    verdict: Verdict
    signals: Signals
    joints: tuple[Joint, ...]
    judged: tuple[LeftOut, ...]
    seed: int = 0

    def __repr__(self) -> str:
        """The verdict on one line."""
        return f"<MotionDiagnosis of {self.verdict.headline}>"

    def _repr_html_(self) -> str:
        return self.card()

    @property
    def by_joint(self) -> list[dict[str, float]]:
        """Root mean squares of every joint, ``before`` and ``after``, left out [rad]."""
        return by_joint({j.number: x for j, x in zip(self.joints, self.judged, strict=True)})

    @property
    def fits(self) -> dict[int, Fit]:
        """Effects with their values by joint, from 1."""
        return {joint.number: joint.fit for joint in self.joints}

    def transfer(self, other: MotionRecording) -> tuple[Array, Array]:
        """Root mean squares (n,) on another recording, ideal and with the causes: nothing refitted.

        Raises:
            PlumblineError: It is another kind of command, or of another number of joints.
        """
        mine = self.recording
        if (other.n, other.law) != (mine.n, mine.law):
            raise PlumblineError(
                f"{other.name}: {other.n} joints by {other.law}, expected {mine.n} by {mine.law} "
                f"as in {mine.name}; give a motion of the same drives"
            )
        signals = signals_of(other)
        starts = spread(signals.starts, MOST_JUDGED)
        before, after = np.full((2, other.n), np.nan)
        for number, fit in self.fits.items():
            windows = signals.windows(number - 1, starts)
            before[number - 1] = np.sqrt(evaluated(windows, (), np.empty(0)).square)
            after[number - 1] = np.sqrt(evaluated(windows, fit.effects, fit.theta).square)
        return before, after

    @property
    def judged_fits(self) -> Judgement:
        """Whether every fit behind the verdict converged."""
        return self.verdict.judged

    def card(self) -> str:
        """The verdict's card of HTML."""
        return self.verdict.card()

    def plot(self) -> Figure:
        """The verdict's picture: the gap as the joints' causes go in."""
        return self.verdict.plot()

    def to_dict(self) -> dict[str, Any]:
        """The verdict's figures as plain data in SI units, with those of every joint."""
        return self.verdict.to_dict() | {"joints": self.by_joint}

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Store the verdict, which ``plumbline.Verdict.load`` brings back.

        Raises:
            PlumblineError: There is a file already, or it cannot be written.
        """
        self.verdict.save(path, overwrite=overwrite)


def diagnose_motion(
    recording: MotionRecording | str | Path,
    *,
    library: Sequence[type[MotionEffect]] = MOTION_EFFECTS,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> MotionDiagnosis:
    """Say what each joint's drive does to its commands.

    Args:
        recording: What was recorded, or the folder of it.
        library: Effects to consider.
        seed: Of the interval's draws.
        progress: Called with what is being done and the share done.

    Raises:
        PlumblineError: The folder cannot be used, or no run is as long as a window.
    """
    r = recording if isinstance(recording, MotionRecording) else load_motion(recording)
    signals = signals_of(r)
    masses = signals.has_masses
    effects = tuple(e for c in library for e in c.candidates(r.law, masses=masses))
    training = spread(signals.starts[signals.folds != 0] if signals.held.any() else signals.starts)
    if not len(training):
        raise PlumblineError(
            f"{r.name}: no run is as long as a window of {signals.length * signals.dt:.3g} s; "
            "hold fewer rows out, or record for longer"
        )
    moved = [j for j in range(r.n) if np.ptp(r.command[:, j]) + np.ptp(r.q[:, j]) > STILL]
    prior = 1 - (1 - UNLISTED) ** (1 / max(len(moved), 1))
    joints, judged = [], []
    for k, j in enumerate(moved):
        if progress is not None:
            progress(f"joint {j + 1}", k / len(moved))
        windows = signals.windows(j, training)
        joint = search(j + 1, windows, effects, signals.seen(j), 0.0, prior)
        joints.append(joint)
        judged.append(left_out(signals, joint))
    still = [j + 1 for j in range(r.n) if j not in moved]
    found = Found(r, joints, judged, still, signals.held_out_by, seed)
    return MotionDiagnosis(r, verdict_of(found), signals, tuple(joints), tuple(judged), seed)

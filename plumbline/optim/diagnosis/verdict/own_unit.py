"""A verdict on efforts in newton metres, whose residuals are fitted in units of each joint's noise.

One factor brings them back: the root mean square of the joints' noises. So the gap in newton metres
is that of an arm whose joints were all as noisy, and the noise floor is the noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from plumbline.optim.diagnosis.findings import Cause, Verdict
from plumbline.optim.diagnosis.of_recordings import JointGap
from plumbline.optim.diagnosis.predict.held_out import Evaluation
from plumbline.optim.measurement.torque import newton_metres, own_units
from plumbline.optim.recording.recording import Recording


def in_own_unit(verdict: Verdict, recording: Recording, evaluation: Evaluation) -> Verdict:
    """The verdict with its gap, its causes' gaps and its noise in the unit that was measured."""
    if not recording.kind.efforts:
        return verdict
    by, gap, noise = newton_metres(recording), verdict.gap, verdict.noise
    return replace(
        verdict,
        gap=replace(
            gap, before=by * gap.before, after=by * gap.after, noise_floor=by * gap.noise_floor
        ),
        noise=replace(noise, sigma=by * noise.sigma),
        causes=tuple(_scaled(cause, by) for cause in verdict.causes),
        candidates=tuple(_scaled(cause, by) for cause in verdict.candidates),
        staircase=tuple(replace(step, gap=by * step.gap) for step in verdict.staircase),
        joints=tuple(_joints(recording, evaluation)),
    )


def _joints(recording: Recording, evaluation: Evaluation) -> Iterator[JointGap]:
    """What is left of every joint's efforts on rows that were left out [N m], [N] if it slides."""
    rows, own = evaluation.rows, own_units(recording)
    pairs = zip(evaluation.before[rows].T, evaluation.after[rows].T, strict=True)
    for j, (kind, sides) in enumerate(zip(recording.chain.kinds, pairs, strict=True)):
        before, after = (float(own[j] * np.sqrt(np.mean(side**2))) for side in sides)
        yield JointGap(
            j + 1, f"joint {j + 1}", before, after, "N" if kind == "prismatic" else "N m"
        )


def _scaled(cause: Cause, by: float) -> Cause:
    return replace(cause, before=by * cause.before, after=by * cause.after)

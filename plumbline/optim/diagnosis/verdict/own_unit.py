"""A verdict on efforts in newton metres, whose residuals are fitted in units of each joint's noise.

The gap is the root mean square over all joints of what was measured, as the noise is, so that
some joint misses by as much or more. What a linear problem says of fewer causes keeps its ratio.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from plumbline.optim.diagnosis.findings import Cause, Verdict
from plumbline.optim.diagnosis.of_recordings import JointGap
from plumbline.optim.diagnosis.predict.held_out import Evaluation
from plumbline.optim.diagnosis.verdict.judge import gap_of
from plumbline.optim.measurement.torque import newton_metres, own_units
from plumbline.optim.recording.recording import Recording


def in_own_unit(verdict: Verdict, recording: Recording, evaluation: Evaluation) -> Verdict:
    """The verdict with its gap, its causes' gaps and its noise in the unit that was measured."""
    if not recording.kind.efforts:
        return verdict
    by, own = newton_metres(recording), own_units(recording)
    sides = (evaluation.before * own / by, evaluation.after * own / by)
    measured = replace(evaluation, before=sides[0], after=sides[1], interval=evaluation.told)
    gap, least = gap_of(measured, verdict.noise), max(evaluation.rms_after, 1e-300)
    per = by * measured.rms_after / least  # of what the linear problem says of fewer causes
    first, *steps = verdict.staircase
    return replace(
        verdict,
        gap=replace(
            gap, before=by * gap.before, after=by * gap.after, noise_floor=by * gap.noise_floor
        ),
        noise=replace(verdict.noise, sigma=by * verdict.noise.sigma),
        causes=tuple(_scaled(cause, per) for cause in verdict.causes),
        candidates=tuple(_scaled(cause, per) for cause in verdict.candidates),
        staircase=(
            replace(first, gap=by * gap.before),
            *(replace(step, gap=per * step.gap) for step in steps),
        ),
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

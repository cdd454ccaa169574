r"""Do the tips meet the model at all? No gap of a robot is as wide as a joint in the wrong column.

The misfit is what remains between measured and predicted tips after the best frame and tool,

.. math:: \min_{R, t, d} \operatorname{median}_i |R\,(p_i + R_i d) + t - y_i|

(the minimum by squares). Where it is a good part of the spread of the tips, the model is another
robot's, or columns are swapped or turned round; the likeliest of these are tried.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from optim.faults import Array, Origin
from optim.kinds import KINDS
from optim.rigid_match import best_rotation, some_of, spread

if TYPE_CHECKING:
    from optim.recording import Recording

HUGE = 0.05  # of the tips' spread: no robot that is one misses its model so far
FEWEST = 5  # rows: frame and tool fit almost any four
OUT_OF_BASE = 0.25  # of the tips' spread: readings so far off are not in the robot's base frame
MENDED = 0.1  # of the misfit is left where a change of the columns is the right one
ROUNDS = 30


def tips_meet_the_model(r: Recording, origin: Origin) -> Iterator[str]:
    """Tips that miss the model by far are noted, with the change of columns that mends it."""
    if KINDS[r.observation].columns[:3] != ("x", "y", "z") or len(r) < FEWEST:
        return
    some = some_of(len(r))
    q, tips = r.q[some], r.measured[some, :3]
    wide = spread(tips)
    # The frame alone is quick, and most tips meet the model without the tool's help.
    if not _missed(r, q, tips, rounds=0) > HUGE * wide > 0.0:
        return
    missed = _missed(r, q, tips)
    if not missed > HUGE * wide:
        return
    said = f"the tips miss the model by {missed:.2g} m over a spread of {wide:.2g} m"
    better = [(m, words) for words, other in _changes(q) if (m := _missed(r, other, tips))]
    least, words = min(better, default=(missed, ""))
    if least < MENDED * missed:
        yield f"{origin.file}: {said}, but by {least:.2g} m with {words}: mend these columns"
    else:
        wrong = "joint order, joint signs, robot, tip frame or unit wrong?"
        yield f"{origin.file}: {said}: {wrong}"


def encoders_meet_the_motors(r: Recording, origin: Origin) -> Iterator[str]:
    """Link-side encoders that read a whole turn more, or the other way round, are noted."""
    if r.observation != "joint_position":
        return
    for j in r.measured_joints:
        read, expected = r.measured[:, j], r.q[:, j]
        turns = round(float(np.median(read - expected)) / (2 * np.pi))
        if r.chain.kinds[j] == "revolute" and turns:
            yield f"{origin.file}: m{j + 1} is {turns:+d} whole turns off q{j + 1}: mend the column"
        same, turned = np.std(read - expected), np.std(read + expected)
        if turned < MENDED * same:
            yield f"{origin.file}: m{j + 1} runs against q{j + 1}: turn the sign of this column"


def far_from_base(r: Recording) -> float:
    """How far [m] readings are off if taken in the robot's base frame; 0 where they may be in it.

    In the median; a wrong tool or a large gap is no reason to doubt the frame.
    """
    if KINDS[r.observation].columns[:3] != ("x", "y", "z"):
        return 0.0
    some = some_of(len(r))
    tips = r.measured[some, :3]
    off = r.chain.tips(r.q[some], r.tool_offset) - tips
    missed = float(np.median(np.linalg.norm(off, axis=1)))
    return missed if missed > OUT_OF_BASE * spread(tips) else 0.0


def _changes(q: Array) -> Iterator[tuple[str, Array]]:
    """Joint readings (N, n) with two columns swapped, or with the sign of one turned."""
    for i, j in combinations(range(q.shape[1]), 2):
        order = np.arange(q.shape[1])
        order[[i, j]] = j, i
        yield f"q{i + 1} and q{j + 1} swapped", q[:, order]
    for j in range(q.shape[1]):
        yield f"the sign of q{j + 1} turned", q * np.where(np.arange(q.shape[1]) == j, -1.0, 1.0)


def _missed(r: Recording, q: Array, tips: Array, rounds: int = ROUNDS) -> float:
    """Median misfit [m] of tips (N, 3) after the best frame and, where it is fitted, tool."""
    T = r.chain.placement(q)
    R, p, tool = T[:, :3, :3], T[:, :3, 3], r.tool_offset
    frame, gaps = _matched(p + R @ tool, tips)
    for _ in range(rounds if "tool" in r.always else 0):
        # The tool that closes the gaps, seen from the tip, each about its mean.
        inner = R - R.mean(axis=0)
        away = gaps @ frame
        tool = tool + np.linalg.lstsq(inner.reshape(-1, 3), away.ravel(), rcond=1e-3)[0]
        frame, gaps = _matched(p + R @ tool, tips)
    return float(np.median(np.linalg.norm(gaps, axis=1)))


def _matched(predicted: Array, measured: Array) -> tuple[Array, Array]:
    """The best frame's rotation (3, 3), and measured minus predicted (N, 3) in it [m]."""
    a, b = predicted - predicted.mean(axis=0), measured - measured.mean(axis=0)
    frame = best_rotation(a, b)
    return frame, b - a @ frame.T

"""Do the rows meet the model at all? No gap of a robot is as wide as a joint in the wrong column.

What another simple set-up mends is named (:mod:`plumbline.optim.recording.set_up`); where the
misfit is a good part of the spread of the tips and nothing simple mends it, the model is another
robot's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from plumbline.optim.recording.constants import FEWEST, HUGE, MOUNTED, OUT_OF_BASE, UNMET
from plumbline.optim.recording.origin import Origin
from plumbline.optim.recording.set_up import missed as misfit_of
from plumbline.optim.recording.set_up import wrong_set_up
from plumbline.optim.recording.slips import whole_turns
from plumbline.optim.rigid import some_of, spread

if TYPE_CHECKING:
    from plumbline.optim.recording.recording import Recording


def rows_meet_the_model(r: Recording, origin: Origin) -> Iterator[str]:
    """Rows that miss the model by far are noted, with the change of the set-up that mends it."""
    wrong = wrong_set_up(r)
    if wrong is not None:
        yield f"{origin.file}: {wrong.words}: mend this; diagnose refuses it unless forced"
    elif said := unmet(r, HUGE):
        yield f"{origin.file}: {said}"


def unmet(r: Recording, share: float = UNMET) -> str:
    """What to doubt where tips miss the model by a share of their spread; empty if they do not."""
    if not r.kind.device or len(r) < FEWEST:
        return ""
    some = r.select(some_of(len(r)))
    missed, wide = misfit_of(some), spread(some.measured[:, :3])
    if not missed > share * wide > 0.0:
        return ""
    said = f"the tips miss the model by {missed:.2g} m over a spread of {wide:.2g} m"
    return f"{said}: joint order, joint signs, robot, tip frame or unit wrong?"


def counted_from_one_turn(r: Recording, origin: Origin) -> tuple[Recording, list[str]]:
    """Link-side angles in the turn of most rows, since an encoder tells them to a turn alone."""
    measured, notes = r.measured.copy(), []
    for j in r.measured_joints if r.kind.encoders else ():
        turns = whole_turns(r.measured[:, j] - r.q[:, j])
        if r.chain.kinds[j] == "revolute" and turns.any():
            measured[:, j] -= 2 * np.pi * turns
            off = f"{np.median(turns):+.0f} whole turns" if turns.all() else "whole turns"
            rows = f"in {np.count_nonzero(turns)} of {len(r)} rows: taken to a turn"
            notes.append(f"{origin.file}: m{j + 1} is {off} off q{j + 1} {rows}")
    return (replace(r, measured=measured) if notes else r), notes


def zeros_by_mounting(r: Recording) -> Recording:
    """The recording with second encoders' zeros always fitted where some are no joint's error.

    A link-side encoder may be mounted at any angle, of which its readings cannot tell the joint's
    own zero. One that is farther off than a zero ever was tells that zeros are where they were put.
    """
    if not r.kind.encoders or "joint_offset" in r.always:
        return r
    off = {j + 1: float(np.median(r.measured[:, j] - r.q[:, j])) for j in r.measured_joints}
    far = {j: zero for j, zero in off.items() if abs(zero) > MOUNTED}
    if not far:
        return r
    units = {j: "m" if r.chain.kinds[j - 1] == "prismatic" else "rad" for j in far}
    said = ", ".join(f"m{j} by {zero:.3g} {units[j]}" for j, zero in far.items())
    note = f"zeros of second encoders are off ({said}): all are taken for their mounting, fitted"
    told = f"{note} and not judged"
    return replace(r, always=(*r.always, "joint_offset"), notes=(*r.notes, told))


def far_from_base(r: Recording) -> float:
    """How far [m] readings are off if taken in the robot's base frame; 0 where they may be in it.

    In the median; a wrong tool or a large gap is no reason to doubt the frame.
    """
    if not r.kind.device:
        return 0.0
    some = some_of(len(r))
    tips = r.measured[some, :3]
    off = r.chain.tips(r.q[some], r.tool_offset) - tips
    missed = float(np.median(np.linalg.norm(off, axis=1)))
    return missed if missed > OUT_OF_BASE * spread(tips) else 0.0

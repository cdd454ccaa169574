r"""Do the rows meet the model at all? No gap of a robot is as wide as a joint in the wrong column.

What another simple set-up mends is named (:mod:`plumbline.optim.recording.set_up`); where the
misfit is a good part of the spread of the tips and nothing simple mends it, the model is another
robot's.

In which order and sense are quaternions written? The positions and the model tell.

The frame R that carries predicted tips onto the measured ones also turns the predicted rotations,
so that :math:`R_{tip,i}^T R^T R_i` is one fixed rotation, the tool's, in the right convention and
in no other.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from plumbline.errors import fault
from plumbline.optim.recording import constants
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import missed as misfit_of
from plumbline.optim.recording.set_up import plausible, wrong_set_up
from plumbline.optim.recording.slips import whole_turns
from plumbline.optim.recording.table import Array, Origin
from plumbline.optim.rigid import best_rotation, nearest_rotation, rotations, some_of, spread


def rows_meet_the_model(r: Recording, origin: Origin) -> Iterator[str]:
    """Rows that miss the model by far are noted, with the change of the set-up that mends it."""
    wrong = wrong_set_up(r)
    if wrong is not None:
        yield f"{origin.file}: {wrong.words}: mend this; diagnose refuses it unless forced"
    elif said := unmet(r, constants.HUGE):
        yield f"{origin.file}: {said}"


def unmet(r: Recording, share: float = constants.UNMET) -> str:
    """What to doubt where tips, or encoders, miss the model by a share of their spread, or nothing.

    Of several recordings each is asked on its own: its device stands where it likes.
    """
    if r.session is not None:
        each = ((part.name, unmet(part, share)) for part in r.session.parts)
        return next((f"{name}: {words}" for name, words in each if words), "")
    if len(r) < constants.FEWEST:
        return ""
    if r.kind.encoders:
        return _encoders_unmet(r)
    if not r.kind.device:
        return ""
    some = r.select(some_of(len(r)))
    missed, wide = misfit_of(some), spread(some.measured[:, :3])
    if not missed > share * wide > 0.0:
        return ""
    said = f"the tips miss the model by {missed:.2g} m over a spread of {wide:.2g} m"
    return f"{said}: joint order, joint signs, robot, tip frame or unit wrong?"


def _encoders_unmet(r: Recording) -> str:
    """The joint whose second encoder misses it by a share of how far it moved; empty if none."""
    for j in r.measured_joints:
        missed, wide = _about_median(r.measured[:, j] - r.q[:, j]), _about_median(r.measured[:, j])
        if missed > max(constants.UNMET * wide, plausible(r)):
            unit = "rad" if r.chain.turning[j] else "m"
            said = f"m{j + 1} misses q{j + 1} by {missed:.2g} {unit} over a spread of {wide:.2g}"
            return f"{said} {unit}: rows of another time, joint order, joint signs or unit wrong?"
    return ""


def _about_median(values: Array) -> float:
    """Median distance from the median: a few gross errors do not move it."""
    return float(np.median(np.abs(values - np.median(values))))


def counted_from_one_turn(r: Recording, origin: Origin) -> tuple[Recording, list[str]]:
    """Link-side angles in the turn of most rows, since an encoder tells them to a turn alone."""
    measured, notes = r.measured.copy(), []
    for j in r.measured_joints if r.kind.encoders else ():
        turns = whole_turns(r.measured[:, j] - r.q[:, j])
        if r.chain.turning[j] and turns.any():
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
    far = {j: zero for j, zero in off.items() if abs(zero) > constants.MOUNTED}
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
    return missed if missed > constants.OUT_OF_BASE * spread(tips) else 0.0


# Where w, x, y, z stand among the columns qw, qx, qy, qz, the sense of the turn, and the way out.
CONVENTIONS: Mapping[str, tuple[tuple[int, int, int, int], int]] = {
    "x, y, z, w: put w first": ((3, 0, 1, 2), 1),
    "inverse rotations: turn the signs of qx, qy, qz": ((0, 1, 2, 3), -1),
    "x, y, z, w of inverse rotations: put w first and turn the other signs": ((3, 0, 1, 2), -1),
    "w, x, z, y: swap qy and qz": ((0, 1, 3, 2), 1),
    "w, y, x, z: swap qx and qy": ((0, 2, 1, 3), 1),
    "w, z, y, x: swap qx and qz": ((0, 3, 2, 1), 1),
    "w, y, z, x: put x second": ((0, 3, 1, 2), 1),
    "w, z, x, y: put z last": ((0, 2, 3, 1), 1),
    "z, y, x, w: turn their order round": ((3, 2, 1, 0), 1),
}


def quaternions_are_unit(r: Recording, origin: Origin) -> None:
    """Quaternions have norm one."""
    if not r.kind.oriented:
        return
    norm = np.linalg.norm(r.measured[:, 3:], axis=1)
    broken = np.flatnonzero(np.abs(norm - 1.0) > constants.UNIT_TOLERANCE)
    if len(broken):
        mend = "write unit quaternions, w first"
        found = f"a quaternion of norm {norm[broken[0]]:.6g}"
        expected = f"1 within {constants.UNIT_TOLERANCE:g}"
        raise fault(origin.at("qw", broken[0]), found, expected, mend)


def quaternions_are_in_order(r: Recording, origin: Origin) -> None:
    """Quaternions turn with the model as they stand, w first."""
    if not r.kind.oriented:
        return
    some = some_of(len(r))
    predicted = r.chain.placement(r.q[some])[:, :3, :3]
    frame = _frame(r.chain.tips(r.q[some], r.tool_offset), r.measured[some, :3])
    quaternions = normalised(r.measured)[some, 3:]
    as_given = _misfit(predicted, rotations(quaternions), frame)
    if as_given <= constants.ODD:
        return
    left = {
        words: _misfit(predicted, rotations(_read(quaternions, *order)), frame)
        for words, order in CONVENTIONS.items()
    }
    least = min(left.values())
    if least < constants.BETTER * as_given:
        near = [words for words, value in left.items() if value < max(2.0 * least, constants.ALIKE)]
        found = f"rotations {as_given:.2g} rad from the predicted ones, {least:.2g} if reordered"
        mend = f"looks like {' -- or like '.join(near)}"
        raise fault(origin.at("qw", 0), found, "qw, qx, qy, qz", mend)


def normalised(measured: Array) -> Array:
    """Poses (N, 7) with their quaternions' norms made one."""
    q = measured[:, 3:]
    return np.hstack([measured[:, :3], q / np.linalg.norm(q, axis=1, keepdims=True)])


def _read(quaternions: Array, places: tuple[int, int, int, int], sense: int) -> Array:
    read = quaternions[:, list(places)]
    return np.hstack([read[:, :1], sense * read[:, 1:]])


def _frame(predicted: Array, measured: Array) -> Array | None:
    """The frame's rotation (3, 3) by the tips; None where they lie on a line."""
    a, b = predicted - predicted.mean(axis=0), measured - measured.mean(axis=0)
    for cloud in (a, b):
        sizes = np.linalg.svd(cloud, compute_uv=False)
        if len(sizes) < 3 or not sizes[1] > constants.LINE * sizes[0]:
            return None
    return best_rotation(a, b)


def _misfit(predicted: Array, measured: Array, frame: Array | None) -> float:
    """Median angle [rad] to a tool that is fixed, in a frame that is given or fitted."""
    # By the rotations alone where there is none: their axes turn with it.
    R = best_rotation(_axes(predicted), _axes(measured)) if frame is None else frame
    tools = np.swapaxes(predicted, 1, 2) @ R.T @ measured
    mean = nearest_rotation(tools.sum(axis=0))
    chord = np.linalg.norm(tools - mean, axis=(1, 2)) / np.sqrt(8.0)
    return float(np.median(2.0 * np.arcsin(np.clip(chord, 0.0, 1.0))))


def _axes(R: Array) -> Array:
    """Axis times sine (N, 3) of every turn since the first, in the outer frame."""
    since = R @ R[0].T
    half = 0.5 * (since - since.transpose(0, 2, 1))
    return np.stack([half[:, 2, 1], half[:, 0, 2], half[:, 1, 0]], axis=1)

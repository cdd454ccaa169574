r"""A recording of a range finder as what the diagnosis reads: one range a row, planes as its parts.

The fit starts at the beam of least median residual (:mod:`plumbline.optim.hand_eye.start`) and at
the planes of the points that it makes. Where poses are given in place of joint readings, three
slides and three turns stand in for the arm, and nothing is blamed on them.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError, one_line
from plumbline.kinematics.frames import homogeneous
from plumbline.optim.hand_eye.constants import LEAST_ON_PLANE, SPARE
from plumbline.optim.hand_eye.readings import Beam, Frames, Readings
from plumbline.optim.hand_eye.recording import OBSERVATION, EveryRow, RangeRecording
from plumbline.optim.hand_eye.start import refuse_misread, robust_start
from plumbline.optim.recording import checks
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.stand_in import numbered, pose_readings, poses_robot
from plumbline.optim.recording.table import Array, Origin


def ranges_to_diagnose(ranges: RangeRecording) -> Recording:
    """The rows of a recording of ranges, with their planes, motions and context."""
    every = _every(ranges)
    readings = every.readings
    fitted = readings.select(every.held_out == 0)
    _check_planes(ranges, fitted, readings)
    anchor = _start(ranges, fitted)
    # A plane that is not fitted was refused, so those fitted are all.
    part = np.searchsorted(fitted.planes, readings.plane) + 1
    robot = every.robot or poses_robot()
    chain = robot.chain(None if ranges.chain is None else ranges.chain.tip_frame)
    context: dict[str, Any] = dict(every.context)
    shape = context.pop("noise_rows", None)
    mean = None if shape is None else float(np.sqrt(np.mean(shape**2)))
    found = Recording(
        name=ranges.name,
        observation=OBSERVATION,
        robot=robot,
        chain=chain,
        tip_frame=chain.tip_frame,
        q=pose_readings(homogeneous(readings.R, readings.t)) if every.q is None else every.q,
        measured=readings.distance[:, None],
        tool_offset=anchor[0][:3],
        element=part.astype(np.int64),
        motion=readings.motion,
        elements=_names(ranges, fitted),
        anchor=anchor,
        stand_in=every.q is None,
        held_out=every.held_out == 1 if every.held_out.any() else None,
        noise_std=mean or ranges.noise_std,
        noise_shape=None if shape is None or mean is None else shape[:, None] / mean,
        always=every.always,
        sha256=ranges.sha256,
        notes=ranges.notes,
        **context,
    )
    return _checked(found)


def _every(ranges: RangeRecording) -> EveryRow:
    if ranges.every is not None:
        return ranges.every
    held = np.zeros(len(ranges.readings), dtype=np.int64)
    return EveryRow(ranges.readings, None, None, held, {})


def _checked(recording: Recording) -> Recording:
    """With notes on what is odd about its rows."""
    origin = Origin("samples.csv")
    asked = (checks.rows_differ, checks.time_runs_forwards, checks.direction_is_a_side)
    notes = [one_line(note) for check in asked for note in check(recording, origin)]
    named = numbered("planes", recording.elements)
    return replace(recording, notes=(*recording.notes, *named, *notes))


def _check_planes(ranges: RangeRecording, fitted: Readings, readings: Readings) -> None:
    for k, label in zip(readings.planes, _names(ranges, readings), strict=True):
        count = int(np.sum(fitted.plane == k))
        if count < LEAST_ON_PLANE:
            raise PlumblineError(
                f"{ranges.name}: plane {label}: {count} readings to fit, at least {LEAST_ON_PLANE} "
                "expected: three tell where a plane is; take more on it"
            )
    planes = len(fitted.planes)
    least = 5 + 3 * planes + SPARE
    if len(fitted) < least:
        raise PlumblineError(
            f"{ranges.name}: {len(fitted)} readings on {planes} planes, at least {least} expected "
            f"(5 unknowns of the beam, 3 of a plane, {SPARE} to judge by); take more"
        )


def _start(ranges: RangeRecording, readings: Readings) -> tuple[Array, Array]:
    """The beam (6,) and the planes (K, 6): a point each [m] and a direction."""
    beam, sigma, _ = robust_start(readings)
    try:
        refuse_misread(readings, sigma)
    except PlumblineError as error:
        raise PlumblineError(f"{ranges.name}: {error}") from None
    frames = Frames.of(readings, beam)
    planes = np.hstack([_middles(readings, beam, frames), frames.B[:, :, 2]])
    return np.concatenate([beam.r, beam.v]), planes


def _middles(readings: Readings, beam: Beam, frames: Frames) -> Array:
    """Middles of the planes (K, 3) [m], half way between their farthest points along each axis."""
    points = beam.points(readings.R, readings.t, readings.distance)
    index, found = frames.index(readings), []
    for k, (B, c) in enumerate(zip(frames.B, frames.c, strict=True)):
        places = (points[index == k] - c) @ B[:, :2]
        found.append(c + B[:, :2] @ (places.min(axis=0) + places.max(axis=0)) / 2)
    return np.array(found)


def _names(ranges: RangeRecording, readings: Readings) -> tuple[str, ...]:
    planes = readings.planes.tolist()
    return tuple(ranges.labels[k - 1] if ranges.labels else str(k) for k in planes)

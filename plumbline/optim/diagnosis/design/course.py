r"""A recording and rows that are to follow it: the data that each of them would be read with.

Time goes on from the last row; while the arm rests it cools towards the coldest temperature on
record, to a twentieth of the difference within the length of the recording.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as cs
import numpy as np
import scipy

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.design.future_rows import FutureRows
from plumbline.optim.diagnosis.prior import COOLED, MANY_ROWS
from plumbline.optim.measurement.nuisance import Nuisance
from plumbline.optim.measurement.observation import COLUMNS, MeasurementModel, rows_of
from plumbline.optim.measurement.session import Own
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.session import apart


@dataclass(frozen=True, eq=False)
class Course:
    """A recording and the rows that are to follow it."""

    model: MeasurementModel  # the model whose unknowns the rows are to tell
    # the rows decided on so far, in their order; None before the first
    taken: FutureRows | None = None

    @property
    def recording(self) -> Recording:
        """What has been recorded."""
        return self.model.recording

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects of the model."""
        return tuple(term.effect for term in self.model.terms)

    @property
    def is_timed(self) -> bool:
        """Whether a row's time matters, so that a rest before it can tell something."""
        timed = any({"time", "temperature"} & set(e.needs) for e in self.effects)
        return timed and self.recording.time is not None

    @property
    def waited(self) -> float:
        """Rest that the rows decided on take altogether [s]."""
        return (
            0.0 if self.taken is None or self.taken.wait is None else float(self.taken.wait.sum())
        )

    def then(self, row: FutureRows) -> Self:
        """The course with further rows at its end."""
        return replace(self, taken=row if self.taken is None else self.taken + row)

    def recorded(self) -> Recording:
        """The recording with the rows decided on at its end, what they will measure left open.

        Of a long one only its end: no path reaches back further.
        """
        whole = self.recording if self.taken is None else _continued(self.model, self.taken)
        if whole.socket is not None or len(whole) <= MANY_ROWS:
            return whole
        return whole.select(np.arange(len(whole) - MANY_ROWS, len(whole)))

    def rows_next(self, candidates: FutureRows) -> Array:
        """Data (N, k) of candidates, each as the very next row."""
        so_far = self.recorded()
        last = so_far.select([len(so_far) - 1])
        tried = _one_by_one(self.model, so_far, candidates)
        if not any(effect.remembers for effect in self.effects):
            return rows_of(_joined(so_far, tried), self.effects)[len(so_far) :]
        # Back and forth: so each candidate is reached from the last row of the course.
        order = np.arange(2 * len(candidates)) // 2
        forth = np.arange(2 * len(candidates)) % 2 == 1
        back = last.select(np.zeros(len(candidates), dtype=int))
        both = _joined(back, tried).select(np.where(forth, order + len(candidates), order))
        return rows_of(_joined(so_far, both), self.effects)[len(so_far) :][1::2]

    def rows_in_order(self, rows: FutureRows) -> Array:
        """Data (N, k) of rows that follow the course one after another."""
        whole = self.then(rows).recorded()
        return rows_of(whole, self.effects)[-len(rows) :]


def _continued(model: MeasurementModel, rows: FutureRows) -> Recording:
    """A recording with rows at its end, one after another."""
    recording = model.recording
    times, warmths = [], []
    time, warmth = _last(recording.time), _last(recording.temperature)
    waits = np.zeros(len(rows)) if rows.wait is None else rows.wait
    for wait in waits.tolist():
        time, warmth = time + _step(recording) + wait, _cooled(recording, warmth, wait)
        times.append(time)
        warmths.append(warmth)
    return _joined(recording, _as_recording(model, rows, np.array(times), np.array(warmths)))


def _one_by_one(model: MeasurementModel, so_far: Recording, rows: FutureRows) -> Recording:
    """Candidates as a recording (N rows), each of them right after the last row so far."""
    waits = np.zeros(len(rows)) if rows.wait is None else rows.wait
    times = _last(so_far.time) + _step(model.recording) + waits
    warmth = _last(so_far.temperature)
    return _as_recording(model, rows, times, _cooled(model.recording, warmth, waits))


def _last(values: Array | None) -> float:
    return 0.0 if values is None else float(values[-1])


def _step(recording: Recording) -> float:
    """Usual time from row to row [s]."""
    time = recording.time
    return 0.0 if time is None or len(time) < 2 else float(np.median(np.diff(time)))


def _cooled(recording: Recording, warmth: Any, wait: Any) -> Any:
    """Temperature [degC] after a rest [s]."""
    if recording.temperature is None or recording.time is None:
        return warmth + 0.0 * wait
    cold = float(recording.temperature.min())
    length = max(float(np.ptp(recording.time)), 1e-9)
    return cold + (warmth - cold) * COOLED ** (wait / length)


def _as_recording(
    model: MeasurementModel, rows: FutureRows, times: Array, warmths: Array
) -> Recording:
    """Rows as a recording; what was measured is made up, but for a pose's orientation."""
    recording = model.recording
    width = recording.measured.shape[1]
    measured = np.zeros((len(rows), width))
    if recording.several or recording.kind.oriented:
        _orient(model, rows.q, measured)
    given: dict[str, Any] = {"q": rows.q, "measured": measured, "held_out": None}
    given["part"] = None if recording.part is None else np.full(len(rows), recording.part[0])
    given["time"] = None if recording.time is None else times
    given["temperature"] = None if recording.temperature is None else warmths
    given["direction"], given["velocity"] = rows.direction, rows.velocity
    given["payload"], given["socket"] = rows.payload, rows.socket
    effort = recording.effort
    given["effort"] = None if effort is None else np.tile(effort.mean(axis=0), (len(rows), 1))
    force, group = recording.force, recording.group
    usual = None if force is None else np.sqrt(np.mean(force**2, axis=0))
    given["force"] = None if usual is None else np.tile(usual, (len(rows), 1))
    shape = recording.noise_shape
    own = None if shape is None else np.sqrt(np.mean(shape**2, axis=0))
    given["noise_shape"] = None if own is None else np.tile(own, (len(rows), 1))
    given["jitter"], given["scatter"] = 0.0, None
    given["group"] = None if group is None else np.full(len(rows), group[-1])
    return replace(recording, **given)


def _joined(first: Recording, then: Recording) -> Recording:
    """Two recordings of the same columns, one after the other."""
    parts: dict[str, Any] = {"held_out": None}
    for name in ("q", "measured", "socket", "noise_shape", "part", *COLUMNS):
        one, two = getattr(first, name), getattr(then, name)
        parts[name] = None if one is None else np.concatenate([one, two])
    return replace(first, **parts)


def _orient(model: MeasurementModel, q: Array, measured: Array) -> None:
    """Write the quaternions, w first, that the nuisances at the model's start predict, if any.

    Args:
        model: The model.
        q: Postures (N, n) [rad or m].
        measured: What is measured there (N, k); of several recordings columns of all their kinds.
    """
    recording, nuisance = model.recording, model.nuisance
    own: Nuisance | Own = nuisance
    if recording.several:
        session, part = apart(recording)
        if not session.has_poses:
            return
        own = nuisance.own[int(part[0])]
    turns = cs.Function("turns", [nuisance.x], [own.T_device_world.R, own.R_tip_tool])
    R_device_world, R_tip_tool = (R.full() for R in turns(model.start[: nuisance.size]))
    R = R_device_world @ recording.chain.placement(q)[:, :3, :3] @ R_tip_tool
    turned = scipy.spatial.transform.Rotation.from_matrix(R)
    measured[:, 3:7] = turned.as_quat()[:, [3, 0, 1, 2]]

r"""Rows that could be recorded next: postures within reach, sides of approach, waits, payloads.

Joints are drawn evenly over the range that the recording has used (or over the joints' limits), and
the tip stays within the box that it has been in, widened by a tenth, where the device is known to
see it. Time goes on from the last row; while the arm rests it cools towards the coldest temperature
on record, to a twentieth of the difference within the length of the recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kinematics.effects import Effect
from kinematics.evaluate import over_rows
from kinematics.frames import constant
from optim.observation import Model, rows_of
from optim.problem import Array
from optim.recording import Recording

RECORDED, LIMITS = "recorded", "limits"
WIDER = 0.1  # how much of its size the box of tips is widened on each side
TURN = np.pi  # range of a joint that has neither moved nor limits [rad]
ROUNDS = 40
PLACES = 8  # at which a joint is tried when it alone is changed
RESTS = (0.0, 0.0, 0.0, 0.0, 1 / 3, 1.0)  # waits to draw from, over the recording's length
COOLING = 3.0
MEMORY = 1000  # rows that the path of a joint may reach back
STEPS, NEAR = 25, 1e-6  # of bringing a tip into a socket, and how near it must come [m]


@dataclass(frozen=True, eq=False)
class FutureRows:
    """Rows that have not been recorded.

    Attributes:
        q: Joint readings (N, n) [rad or m].
        direction: Side of the approach (N, n), -1 or 1, where the recording has one.
        velocity: Joint velocities (N, n) [rad/s or m/s], where the recording has them.
        wait: Rest before the row (N,) [s], where the recording has a clock.
        payload: Mass carried (N,) [kg], where the recording has one.
        socket: Socket that the tip rests in (N,), for fixed points.
    """

    q: Array
    direction: Array | None = None
    velocity: Array | None = None
    wait: Array | None = None
    payload: Array | None = None
    socket: NDArray[np.int64] | None = None

    def groups(self, recording: Recording) -> NDArray[np.int64] | None:
        """Groups (N,) of the rows: those of the recording in turn; None if it has none.

        Each row is a posture by itself. In a group of their own they would all be left out at once,
        and with them what they were recorded for.
        """
        if recording.group is None:
            return None
        labels = np.unique(recording.group)
        return np.asarray(labels[np.arange(len(self)) % len(labels)])

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.q)

    def select(self, rows: NDArray[Any] | slice | Sequence[int]) -> FutureRows:
        """Some of the rows, in the order asked for."""
        return FutureRows(**{name: array[rows] for name, array in self._arrays().items()})

    def __add__(self, other: FutureRows) -> FutureRows:
        """These rows, then others of the same columns."""
        mine, theirs = self._arrays(), other._arrays()
        return FutureRows(**{name: np.concatenate([mine[name], theirs[name]]) for name in mine})

    def _arrays(self) -> dict[str, Any]:
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: array for name, array in values.items() if array is not None}


def draw_rows(
    recording: Recording,
    count: int,
    seed: int,
    *,
    within: str = RECORDED,
    sockets: Array | None = None,
) -> FutureRows:
    """Draw rows that could be recorded; fewer than asked for where few are within reach.

    Args:
        recording: What has been recorded.
        count: How many rows to draw.
        seed: Of the draws.
        within: ``"recorded"``: every joint within the range of its readings. ``"limits"``: within
            the joint limits, where there are any.
        sockets: Places (s, 3) [m] of the sockets in the base frame, for fixed points.
    """
    rng = np.random.default_rng([seed, 11])
    lower, upper = joint_range(recording, within)
    found, numbers = [np.empty((0, len(lower)))], [np.empty(0, dtype=np.int64)]
    for _ in range(ROUNDS):
        q = rng.uniform(lower, upper, (count, len(lower)))
        number = rng.integers(0, 1 if sockets is None else len(sockets), count)
        if sockets is not None:
            q = _brought_to(recording, q, sockets[number])
        good = _within_reach(recording, q, lower, upper, seen=within == RECORDED)
        if sockets is not None:
            good &= np.linalg.norm(_tips(recording, q) - sockets[number], axis=1) < NEAR
        found.append(q[good])
        numbers.append(number[good])
        if sum(map(len, found)) >= count:
            break
    q, number = np.concatenate(found)[:count], np.concatenate(numbers)[:count]
    return _with_context(recording, q, number, rng)


def changed_in_one(
    recording: Recording, row: FutureRows, seed: Sequence[int], *, within: str = RECORDED
) -> FutureRows:
    """Rows within reach that differ from one row in a single thing.

    That is one joint, anywhere in its range; the side that one joint is approached from, its speed
    turned round with it; or the mass carried. A tip in a socket keeps its posture.

    Args:
        recording: What has been recorded.
        row: The row (1).
        seed: Of where in its range a joint is put.
        within: See :func:`draw_rows`.
    """
    lower, upper = joint_range(recording, within)
    n, places = len(lower), 0 if row.socket is not None else PLACES
    sides = n if row.direction is not None or row.velocity is not None else 0
    masses = 0 if row.payload is None or recording.payload is None else 1
    found = row.select(np.zeros(n * places + sides + masses, dtype=int))
    rng = np.random.default_rng(seed)
    at = (np.arange(places) + rng.uniform(0.0, 1.0, (n, places))) / max(places, 1)
    moved, turned = np.arange(n * places), n * places + np.arange(sides)
    found.q[moved, np.repeat(np.arange(n), places)] = (
        lower[:, None] + at * (upper - lower)[:, None]
    ).ravel()
    for column in (found.direction, found.velocity):
        if column is not None:
            column[turned, np.arange(sides)] *= -1.0
    if masses and found.payload is not None and recording.payload is not None:
        found.payload[-1] = recording.payload.min() + recording.payload.max() - found.payload[-1]
    # A posture that is kept is within reach, wherever it came from.
    seen = within == RECORDED and row.socket is None
    return found.select(_within_reach(recording, found.q, lower, upper, seen=seen))


def joint_range(recording: Recording, within: str) -> tuple[Array, Array]:
    """Lower and upper bounds (n,) of joints to come [rad or m].

    Raises:
        ValueError: ``within`` is unknown.
    """
    low, high = recording.q.min(axis=0), recording.q.max(axis=0)
    if within == RECORDED:
        return low, high
    if within != LIMITS:
        raise ValueError(f"within {within!r} not recognised: {RECORDED} or {LIMITS}")
    lower, upper = recording.chain.lower, recording.chain.upper
    turning = np.array([kind == "revolute" for kind in recording.chain.kinds])
    # Without limits a revolute joint may turn once; a slide keeps to where it has been.
    lower = np.where(np.isfinite(lower), lower, np.where(turning, np.minimum(low, -TURN), low))
    upper = np.where(np.isfinite(upper), upper, np.where(turning, np.maximum(high, TURN), high))
    return np.minimum(lower, low), np.maximum(upper, high)


def _within_reach(
    recording: Recording, q: Array, lower: Array, upper: Array, *, seen: bool
) -> NDArray[np.bool_]:
    """Rows within joint ranges, and with their tips where the device has seen the tip before."""
    good = np.all((q >= lower) & (q <= upper), axis=1)
    if seen and recording.observation in ("tip_position", "pose"):
        known, tips = _tips(recording, recording.q), _tips(recording, q)
        low, high = known.min(axis=0), known.max(axis=0)
        margin = WIDER * (high - low)
        good &= np.all((tips >= low - margin) & (tips <= high + margin), axis=1)
    return np.asarray(good)


def _tips(recording: Recording, q: Array) -> Array:
    """Nominal tips (N, 3) in the base frame [m]."""
    T = recording.chain.placement(q)
    return np.asarray(T[:, :3, :3] @ recording.tool_offset + T[:, :3, 3])


def _brought_to(recording: Recording, q: Array, goal: Array) -> Array:
    """Postures (N, n) near q whose nominal tips are at the goals (N, 3) [m], by damped steps."""
    symbol = cs.SX.sym("q", recording.chain.n)
    tip = recording.chain.forward(symbol).point(constant(recording.tool_offset))
    both = cs.Function("tip", [symbol], [cs.densify(tip), cs.densify(cs.jacobian(tip, symbol).T)])
    for _ in range(STEPS):
        tips, J = over_rows(both, q)
        gap = goal - tips[:, 0]
        square = J @ J.transpose(0, 2, 1) + 1e-9 * np.eye(3)
        step = np.einsum("nij,ni->nj", J, np.linalg.solve(square, gap[..., None])[..., 0])
        size = np.linalg.norm(step, axis=1, keepdims=True)
        q = q + step * np.minimum(1.0, 0.5 / np.maximum(size, 1e-12))
    return q


def _with_context(
    recording: Recording, q: Array, number: NDArray[np.int64], rng: np.random.Generator
) -> FutureRows:
    """Rows with what else the recording writes down."""
    side = rng.choice([-1.0, 1.0], size=q.shape)
    speed = rng.uniform(0.0, 1.0, q.shape)
    rest = rng.choice(RESTS, size=len(q))
    mass = rng.integers(0, 2, len(q))
    context: dict[str, Any] = {}
    if recording.direction is not None:
        context["direction"] = side
    if recording.velocity is not None:
        context["velocity"] = side * speed * np.abs(recording.velocity).max(axis=0)
    if recording.time is not None:
        context["wait"] = rest * float(np.ptp(recording.time))
    if recording.payload is not None:
        context["payload"] = np.where(mass, recording.payload.max(), recording.payload.min())
    if recording.socket is not None:
        context["socket"] = np.unique(recording.socket)[number]
    return FutureRows(q, **context)


@dataclass(frozen=True, eq=False)
class Course:
    """A recording and the rows that are to follow it.

    Attributes:
        model: The model whose unknowns the rows are to tell.
        taken: The rows decided on so far, in their order; None before the first.
    """

    model: Model
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
    def _has_path(self) -> bool:
        return any(type(e).derive is not Effect.derive for e in self.effects)

    @property
    def waited(self) -> float:
        """Rest that the rows decided on take altogether [s]."""
        return (
            0.0 if self.taken is None or self.taken.wait is None else float(self.taken.wait.sum())
        )

    def then(self, row: FutureRows) -> Course:
        """The course with further rows at its end."""
        return replace(self, taken=row if self.taken is None else self.taken + row)

    def recorded(self) -> Recording:
        """The recording with the rows decided on at its end, what they will measure left open.

        Of a long one only its end: no path reaches back further.
        """
        whole = self.recording if self.taken is None else _continued(self.model, self.taken)
        if whole.socket is not None or len(whole) <= MEMORY:
            return whole
        return whole.select(np.arange(len(whole) - MEMORY, len(whole)))

    def rows_next(self, candidates: FutureRows) -> Array:
        """Data (N, k) of candidates, each as the very next row."""
        so_far = self.recorded()
        last = so_far.select([len(so_far) - 1])
        tried = _one_by_one(self.model, so_far, candidates)
        if not self._has_path:
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


def _continued(model: Model, rows: FutureRows) -> Recording:
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


def _one_by_one(model: Model, so_far: Recording, rows: FutureRows) -> Recording:
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
    return cold + (warmth - cold) * np.exp(-COOLING * wait / length)


def _as_recording(model: Model, rows: FutureRows, times: Array, warmths: Array) -> Recording:
    """Rows as a recording; what was measured is made up, but for a pose's orientation."""
    recording = model.recording
    width = recording.measured.shape[1]
    measured = np.zeros((len(rows), width))
    if recording.observation == "pose":
        measured[:, 3:] = _orientations(model, rows.q)
    given: dict[str, Any] = {"q": rows.q, "measured": measured, "group": None, "held_out": None}
    given["time"] = None if recording.time is None else times
    given["temperature"] = None if recording.temperature is None else warmths
    given["direction"], given["velocity"] = rows.direction, rows.velocity
    given["payload"], given["socket"] = rows.payload, rows.socket
    effort = recording.effort
    given["effort"] = None if effort is None else np.tile(effort.mean(axis=0), (len(rows), 1))
    return replace(recording, **given)


def _joined(first: Recording, then: Recording) -> Recording:
    """Two recordings of the same columns, one after the other, without groups."""
    names = ("q", "measured", "time", "temperature", "direction", "velocity", "effort", "payload")
    parts: dict[str, Any] = {"group": None, "held_out": None}
    for name in (*names, "socket"):
        one, two = getattr(first, name), getattr(then, name)
        parts[name] = None if one is None else np.concatenate([one, two])
    return replace(first, **parts)


def _orientations(model: Model, q: Array) -> Array:
    """Unit quaternions (N, 4), w first, that the nuisances at the model's start predict."""
    nuisance = model.nuisance
    turns = cs.Function("turns", [nuisance.x], [nuisance.T_device_world.R, nuisance.R_tip_tool])
    R_device_world, R_tip_tool = (R.full() for R in turns(model.start[: nuisance.size]))
    R = R_device_world @ model.recording.chain.placement(q)[:, :3, :3] @ R_tip_tool
    return np.asarray(Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]])

r"""Rows that could be recorded next: postures within reach, sides of approach, waits, payloads.

Joints are drawn evenly over the range that the recording has used (or over the joints' limits), and
the tip stays within the box that it has been in: there the device is known to see it, and below it
there may be a table. A joint that follows another by a linkage goes where that takes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import constant
from plumbline.optim.core.problem import Array, Flags, Integers
from plumbline.optim.diagnosis.constants import DRAW_ROUNDS, NEAR, PLACES, REACHING_STEPS, RESTS
from plumbline.optim.recording.recording import Recording

RECORDED, LIMITS = "recorded", "limits"
TURN = np.pi  # range of a joint that has neither moved nor limits [rad]


@dataclass(frozen=True, eq=False)
class FutureRows:
    """Rows that have not been recorded."""

    q: Array  # joint readings (N, n) [rad or m]
    # side of the approach (N, n), -1 or 1, where the recording has one
    direction: Array | None = None
    # joint velocities (N, n) [rad/s or m/s], where the recording has them
    velocity: Array | None = None
    wait: Array | None = None  # rest before the row (N,) [s], where the recording has a clock
    payload: Array | None = None  # mass carried (N,) [kg], where the recording has one
    socket: Integers | None = None  # socket that the tip rests in (N,), for fixed points

    def groups(self, recording: Recording) -> Integers | None:
        """Groups (N,) of the rows: those of the recording in turn; None if it has none.

        Each row is a posture by itself. In a group of their own they would all be left out at once,
        and with them what they were recorded for.
        """
        if recording.group is None:
            return None
        labels = np.unique(recording.group)
        return np.asarray(labels[np.arange(len(self)) % len(labels)])

    def __len__(self) -> int:
        return len(self.q)

    def select(self, rows: NDArray[Any] | slice | Sequence[int]) -> FutureRows:
        """Some of the rows, in the order asked for."""
        return FutureRows(**{name: array[rows] for name, array in self._arrays().items()})

    def __add__(self, other: FutureRows) -> FutureRows:
        mine, theirs = self._arrays(), other._arrays()
        return FutureRows(**{name: np.concatenate([mine[name], theirs[name]]) for name in mine})

    def _arrays(self) -> dict[str, Any]:
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: array for name, array in values.items() if array is not None}


@dataclass(frozen=True, eq=False)
class Linkage:
    """How joints that follow another move with it, q = share q + rest; all others move alone."""

    share: Array  # (n, n); a follower's column is zero
    rest: Array  # (n,) [rad or m]

    @classmethod
    def of(cls, recording: Recording) -> Self:
        """A follower's zero is where the recording has it, read on its own or not."""
        share = np.eye(recording.chain.n)
        for j, joint in enumerate(recording.chain.joints):
            for k, times in joint.drags:
                share[k] = times * np.eye(len(share))[j]
        return cls(share, np.median(recording.q - recording.q @ share.T, axis=0))

    def postures(self, q: Array) -> Array:
        """Readings (N, n) with those of the followers where the others take them."""
        return np.asarray(q @ self.share.T + self.rest)

    def taken(self, rows: FutureRows) -> FutureRows:
        """The rows as the linkage has them: each follower's posture, side and speed."""
        side, speed = (
            None if v is None else v @ self.share.T for v in (rows.direction, rows.velocity)
        )
        side = None if side is None else np.sign(side)
        return replace(rows, q=self.postures(rows.q), direction=side, velocity=speed)


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
    linkage = Linkage.of(recording)
    found, numbers = [np.empty((0, len(lower)))], [np.empty(0, dtype=np.int64)]
    for _ in range(DRAW_ROUNDS):
        q = linkage.postures(rng.uniform(lower, upper, (count, len(lower))))
        number = rng.integers(0, 1 if sockets is None else len(sockets), count)
        if sockets is not None:
            q = _brought_to(recording, q, sockets[number])
        good = _within_reach(recording, q, lower, upper, seen=within == RECORDED)
        if sockets is not None:
            tips = recording.chain.tips(q, recording.tool_offset)
            good &= np.linalg.norm(tips - sockets[number], axis=1) < NEAR
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
    found = Linkage.of(recording).taken(found)
    # A posture that is kept is within reach, wherever it came from.
    seen = within == RECORDED and row.socket is None
    return found.select(_within_reach(recording, found.q, lower, upper, seen=seen))


def joint_range(recording: Recording, within: str) -> tuple[Array, Array]:
    """Lower and upper bounds (n,) of joints to come [rad or m].

    Raises:
        PlumblineError: ``within`` is unknown.
    """
    low, high = recording.q.min(axis=0), recording.q.max(axis=0)
    if within == RECORDED:
        return low, high
    if within != LIMITS:
        raise PlumblineError(f"within {within!r} not recognised: {RECORDED} or {LIMITS}")
    lower, upper = recording.chain.lower, recording.chain.upper
    turning = recording.chain.turning
    # Without limits a revolute joint may turn once; a slide keeps to where it has been.
    lower = np.where(np.isfinite(lower), lower, np.where(turning, np.minimum(low, -TURN), low))
    upper = np.where(np.isfinite(upper), upper, np.where(turning, np.maximum(high, TURN), high))
    return np.minimum(lower, low), np.maximum(upper, high)


def _within_reach(
    recording: Recording, q: Array, lower: Array, upper: Array, *, seen: bool
) -> Flags:
    """Rows within joint ranges, and with their tips where the device has seen the tip before."""
    good = np.all((q >= lower) & (q <= upper), axis=1)
    if seen and recording.kind.device:
        known, tips = (recording.chain.tips(p, recording.tool_offset) for p in (recording.q, q))
        low, high = known.min(axis=0), known.max(axis=0)
        good &= np.all((tips >= low - NEAR) & (tips <= high + NEAR), axis=1)
    return np.asarray(good)


def _brought_to(recording: Recording, q: Array, goal: Array) -> Array:
    """Postures (N, n) near q whose nominal tips are at the goals (N, 3) [m], by damped steps."""
    symbol, share = cs.SX.sym("q", recording.chain.n), Linkage.of(recording).share
    tip = recording.chain.forward(symbol).point(constant(recording.tool_offset))
    both = cs.Function("tip", [symbol], [cs.densify(tip), cs.densify(cs.jacobian(tip, symbol).T)])
    for _ in range(REACHING_STEPS):
        tips, J = over_rows(both, q)
        J, gap = J @ share, goal - tips[:, 0]
        square = J @ J.transpose(0, 2, 1) + 1e-9 * np.eye(3)
        step = np.einsum("nij,ni->nj", J, np.linalg.solve(square, gap[..., None])[..., 0])
        size = np.linalg.norm(step, axis=1, keepdims=True)
        q = q + step @ share.T * np.minimum(1.0, 0.5 / np.maximum(size, 1e-12))
    return q


def _with_context(
    recording: Recording, q: Array, number: Integers, rng: np.random.Generator
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
    return Linkage.of(recording).taken(FutureRows(q, **context))

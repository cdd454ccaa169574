r"""Roll-outs of a joint's drive over windows, with exact derivatives.

A row of the problem is a window: its commands, its measured start and H measured samples. With the
drive's step :math:`s' = f(s, u, \theta)`, sensitivities :math:`S = \partial s / \partial \theta`
are carried along,

.. math:: S' = f_s S + f_\theta + f_u\, \dot u(t - d)\, (-\partial d / \partial \theta),

the last term because commands are interpolated at :math:`t - d`: a delay is a number like any
other. The step is compiled once for a set of effects, of any joint and length (``mapaccum``), and
memory grows with the windows that are looked at together, not with the recording.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.drive import Drive, Law, Memory
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.optim.diagnosis.motion.between_rows import (
    bend_of,
    between,
    between_slope,
    share_of_mean,
)
from plumbline.optim.diagnosis.motion.constants import (
    ABREAST,
    OPEN,
    PIECE,
    PIECES,
    POSTURE,
    TOGETHER,
    WIDE,
)

Array = NDArray[np.float64]
Effects = tuple[MotionEffect, ...]
MEMORY = tuple(field.name for field in fields(Memory))
# What lags has more, what plans all.
PLACE, SENT, PLAIN = (MEMORY.index(name) for name in ("place", "sent", "told"))
SMOOTH = (Law.VELOCITY, Law.SMOOTH)  # commands that run smoothly between rows


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of one joint, all of one length."""

    law: Law  # what the joint's command is
    dt: float  # time from sample to sample [s]
    kp: float  # known gain [N m/rad]; zero if there is none
    kd: float  # known damping [N m s/rad]
    command: Array  # commands of the joint's whole recording (N,)
    first: NDArray[np.int64]  # where in it the run of each sample begins (N,): no command is older
    q: Array  # measured positions (N,) [rad]
    posture: Array  # the same smoothed (N,) [rad]
    speed: Array  # measured speeds (N,) [rad/s]
    load: Array  # torque of gravity and of the other joints (N,) [N m]
    inertia: Array  # inertia about the joint (N,) [kg m^2]
    start: NDArray[np.int64]  # sample at which each window starts (W,)
    length: int  # samples after it (H)
    settle: int  # how many of those do not count, since what nobody measured settles in them
    size: float = 1.0  # what a radian is in the unit of ``q``
    bare: float = 1.0  # inertia about the joint at its zero, the others free [kg m^2]
    push: float = 1.0  # what a newton metre of command is in this joint's usual ones
    others: tuple[tuple[Array, Array], ...] = ()  # places and speeds (N,) of each other joint

    def __len__(self) -> int:
        """How many windows there are."""
        return len(self.start)

    @property
    def drive(self) -> Law:
        """The law of a step, which knows only its ends."""
        return Law.POSITION if self.law.ideal else self.law

    @cached_property
    def samples(self) -> NDArray[np.int64]:
        """Indices of the samples that count (W, H - settle)."""
        return self.start[:, None] + np.arange(self.settle + 1, self.length + 1)

    @cached_property
    def measured(self) -> Array:
        """What was measured there (W, H - settle) [rad]."""
        return self.q[self.samples]

    @cached_property
    def given(self) -> Array:
        """Load and inertia (R, steps, 2) of every step of the roll-outs."""
        begin, steps, _ = self.passes
        at = begin[:, None] + np.arange(1, steps.max(initial=0) + 1)
        return np.stack(self.loads(np.minimum(at, len(self.q) - 1)), axis=-1)

    def sizes(self, effects: Effects) -> Array:
        """Factors (P,) by which widths, bounds and starts of parameters grow for this joint."""
        return np.array([self._size(e) for e in effects], dtype=float)

    def _size(self, effect: MotionEffect) -> float:
        if effect.of_command and self.law.pushes:
            return self.push
        return self.size if effect.parameter.unit in ("rad", "rad/s") else 1.0

    def loads(self, at: NDArray[np.int64]) -> tuple[Array, Array]:
        """Load and inertia for the steps that end at samples (...): what pushes feels their mean.

        An ideal servo yields to its load where it is, at the sample itself.
        """
        if not self.law.known and not self.law.pushes:
            return self.load[at], self.inertia[at]
        load, inertia = ((x[at] + x[at - 1]) / 2 for x in (self.load, self.inertia))
        return load, inertia

    def level(self, misses: Array) -> Array:
        """Misses (W, K, ...) without what a window's unknown start makes of them."""
        order = OPEN.get(self.law, 0)
        if not order:
            return misses
        K = self.length - self.settle
        basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, K), order))[0]
        return np.asarray(misses - np.einsum("ka,la,wl...->wk...", basis, basis, misses))

    def integrated(self, features: Array) -> Array:
        """What functions (n, F) that act on a drive's rate or torque do to its place (n, F)."""
        order = OPEN.get(self.law, 0)
        if not order:
            return features
        W, K = len(self), self.length - self.settle
        found = features.reshape(W, K, -1)
        for _ in range(order):
            found = np.cumsum(found, axis=1) / K
        return self.level(found).reshape(W * K, -1)

    @cached_property
    def passes(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Samples where roll-outs begin and how many they take (R,), and that of each window (W,).

        A servo on position forgets where it began, so windows that follow one another are one
        roll-out, with as much before the first as a window is long: what a servo plans, and how
        play lies, are then as the commands before have it.
        """
        if not self.law.follows or not len(self):
            steps = np.full(len(self), self.length, np.int64)
            return self.start, steps, np.arange(len(self), dtype=np.int64)
        run = self.first[self.start]
        new = (np.diff(self.start) > self.length) | (np.diff(run) != 0)
        row = np.concatenate([[0], np.cumsum(new)]).astype(np.int64)
        heads = np.flatnonzero(np.concatenate([[True], new]))
        known = run[heads] + round(POSTURE / 2 / self.dt)  # speeds have rows on both sides
        begin = np.maximum(self.start[heads] - self.length, np.minimum(known, self.start[heads]))
        ends = self.start[np.append(heads[1:], len(self)) - 1] + self.length
        return begin, ends - begin, row

    def asked(
        self, shift: float, begin: NDArray[np.int64], steps: int, late: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Commands (R, steps + 1) obeyed so much later [s], and their derivatives by that.

        What trails a ramp by ``late`` [s] takes the mean of a step, what does not its end: of
        that, too.
        """
        at = np.minimum(begin[:, None] + np.arange(steps + 1), len(self.command) - 1)
        shift += self.law.holds * self.dt  # what stood over the sample before this one
        place = np.clip(at - shift / self.dt, self.first[at], self.last[at])
        low = np.minimum(np.floor(place).astype(np.int64), len(self.command) - 2)
        mean, by_late = share_of_mean(late / self.dt) if self.law.ideal else (1.0, 0.0)
        u, bend = self.command, self.bend
        if self.law in SMOOTH:
            u, bend = u - mean * bend / 12, bend - mean * bend_of(bend, self.first) / 12
        f, slope = place - low, u[low + 1] - u[low]
        ends = self.first[low + 1] > low  # the next run's command is not this one's
        slope[ends] = 0.0
        if self.law.holds:
            return u[low] + f * slope, -slope / self.dt, np.zeros_like(f)
        bends = [np.where(ends, 0.0, bend[low + k]) for k in (0, 1)]
        if self.law not in SMOOTH:  # a corner within a step is off its line
            corner = (bends[0] + bends[1]) / 4
            straight = u[low] + f * slope - f * (1 - f) * mean * corner
            less = -(slope - (1 - 2 * f) * mean * corner) / self.dt
            return straight, less, -by_late * f * (1 - f) * corner / self.dt
        more = -by_late * ((1 - f) * self.bend[low] + f * self.bend[low + 1]) / 12 / self.dt
        less = -between_slope(slope, bends, f) / self.dt
        return between(u[low], slope, bends, f), less, more

    @cached_property
    def last(self) -> NDArray[np.int64]:
        """Where in the recording the run of each sample ends (N,): no command is later."""
        begins, run = np.unique(self.first, return_inverse=True)
        return np.append(begins[1:], len(self.first))[run] - 1

    @cached_property
    def bend(self) -> Array:
        """Second differences of the commands (N,), none where a run begins or ends."""
        return bend_of(self.command, self.first)


def roll_out(
    windows: Windows, effects: Effects, theta: Array, *, slopes: bool = True, rough: bool = False
) -> tuple[Array, Array]:
    """Predicted positions (W, H - settle) [rad] and their derivatives (W, H - settle, P).

    Of none (P = 0) where no slopes are asked for; rough ones of a way are differences to one side.
    """
    many = range(0, len(windows), TOGETHER) if len(windows) > TOGETHER else ()
    parts = [replace(windows, start=windows.start[k : k + TOGETHER]) for k in many] or [windows]
    found = [_rolled(part, effects, theta, slopes, rough) for part in parts]
    out = found[0] if len(found) == 1 else np.concatenate(found)
    return out[..., 0], out[..., 1:]


def _rolled(w: Windows, effects: Effects, theta: Array, slopes: bool, rough: bool) -> Array:
    """Positions and their derivatives (W, H - settle, 1 + P)."""
    if not len(w):
        return np.empty((0, w.length - w.settle, 1 + len(theta) * slopes))
    begin, _, row = w.passes
    at = (w.start - begin[row])[:, None] + np.arange(w.settle, w.length)
    given = tuple(range(len(theta))) if slopes else ()
    if not any(effect.plans for effect in effects):
        return np.asarray(_passed(w, effects, theta, given)[row[:, None], at])
    # A planned way switches between full speed up and full braking: a small change moves every
    # later switch, so that derivatives grow without end where differences over a wide step do not.
    # What acts behind the way moves no switch.
    behind = tuple(k for k in given if k not in _planning(effects))
    there = _passed(w, effects, theta, behind)
    out = np.empty((*there.shape[:2], 1 + len(given)))
    out[..., [0, *(1 + k for k in behind)]] = there
    for k in set(given).difference(behind):
        low, high = _wide(w, effects, theta, k)
        one_sided = rough and high[k] > theta[k]
        back = theta if one_sided else low
        near = there[..., 0] if one_sided else _passed(w, effects, low, ())[..., 0]
        with np.errstate(over="ignore", invalid="ignore"):  # where a way runs off, no step is taken
            slope = (_passed(w, effects, high, ())[..., 0] - near) / (high[k] - back[k])
        out[..., 1 + k] = np.where(np.isfinite(slope), slope, 0.0)
    return np.asarray(out[row[:, None], at])


def _wide(w: Windows, effects: Effects, theta: Array, k: int) -> tuple[Array, Array]:
    """Values (P,) to either side: by a share of the width, or of a limit itself; in bounds."""
    p, size = effects[k].parameter, w.sizes(effects[k : k + 1])[0]
    step = WIDE * (abs(theta[k]) if p.null > p.scale else p.scale * size)
    behind, ahead = np.array(theta), np.array(theta)
    behind[k], ahead[k] = max(theta[k] - step, p.lower * size), min(theta[k] + step, p.upper * size)
    return behind, ahead


def _passed(w: Windows, effects: Effects, theta: Array, by: tuple[int, ...]) -> Array:
    """The same of every sample of the roll-outs (R, steps, 1 + B), by so many parameters."""
    begin, steps, _ = w.passes
    P, H, R, size = len(by), int(steps.max()), len(begin), len(_memory(effects))
    shift, yields = (_per_unit(effects, term) for term in ("shift", "compliance"))
    lags = np.array([e.lags for e in effects])
    u, *du = w.asked(float(shift @ theta), begin, H, float(lags @ theta))
    if any(effect.plans for effect in effects):
        du = [np.zeros_like(u)] * 2  # the way is as it is
    abreast = 1 if w.law.follows else ABREAST
    pieces = PIECES if w.law.follows else -(-H // PIECE)
    call = pieces * PIECE
    data = np.ones((-(-R // abreast) * abreast, -(-H // call) * call, 5))  # an inertia of one
    data[:R, :H, :3] = np.stack([u, *du], axis=-1)[:, 1:]
    data[:R, :H, 3:] = w.given
    state = np.zeros((len(data), 1 + P, size))
    state[:R, 0] = _begun(w, u, begin, float(yields @ theta))[:size].T
    late = du[0][:, :1] * shift[list(by)] + du[1][:, :1] * lags[list(by)]
    for k in (k for k in (0, SENT, PLAIN) if k < size):  # what begins at a command is late
        state[:R, 1:, k] = late
    if w.law.ideal:
        state[:R, 1:, PLACE] = w.load[begin][:, None] * yields[list(by)]
    fixed = np.tile([w.dt, w.kp, w.kd, w.bare, *theta], (abreast * pieces, 1))
    after = np.empty((abreast, pieces, 1 + P, size))
    out = np.empty((*data.shape[:2], 1 + P))
    handle: Any = _rolling(w.drive, effects, pieces, abreast, by).buffer()  # addresses alone
    buffer, run = handle
    buffer.set_arg(2, fixed.data)
    buffer.set_res(0, after.data)
    for r in range(0, R, abreast):
        now = state[r : r + abreast]
        buffer.set_arg(0, now.data)
        for k in range(0, int(steps[r]), call):
            buffer.set_arg(1, data[r : r + abreast, k : k + call].data)
            buffer.set_res(1, out[r : r + abreast, k : k + call].data)
            run()
            now[:] = after[:, -1]
    return out


def _memory(effects: Effects) -> tuple[str, ...]:
    """What a drive with these effects keeps from sample to sample."""
    if any(effect.plans for effect in effects):
        return MEMORY
    return MEMORY[: PLAIN if any(isinstance(e, ActuationLag) for e in effects) else SENT]


def _begun(w: Windows, u: Array, start: NDArray[np.int64], compliance: float) -> Array:
    """States (8, w) in which windows begin, as in MEMORY: a planned way is where the joint is.

    A joint within its play stays where it began, which a single reading's noise would move. What
    follows positions without a plan is as fast as those, and its motor ahead of what it yields by.
    """
    now, q, speed = u[:, 0], (w.posture if w.law.follows else w.q)[start], w.speed[start]
    pace = (u[:, 1] - now) / w.dt if w.law.ideal else speed
    motor = q + compliance * w.load[start] if w.law.ideal else q
    return np.stack([now, motor, pace, q, now, now, motor, speed])


@lru_cache(maxsize=1024)
def _rolling(
    law: Law, effects: Effects, pieces: int, abreast: int, by: tuple[int, ...]
) -> cs.Function:
    """So many windows abreast, over so many compiled pieces."""
    several = _piece(law, effects, by).mapaccum("rolled", pieces)
    return several if abreast == 1 else several.map(abreast)


@lru_cache(maxsize=1024)
def _piece(law: Law, effects: Effects, by: tuple[int, ...]) -> cs.Function:
    """Samples in a row; what they share is worked out once."""
    step, seen = _step(law, effects, by), []
    after = both = cs.SX.sym("both", step.size1_in(0))
    data, fixed = cs.SX.sym("data", step.size1_in(1), PIECE), cs.SX.sym("fixed", step.size1_in(2))
    for sample in cs.horzsplit(data):
        after, now = step(after, sample, fixed)
        seen.append(now)
    return cs.Function("piece", [both, data, fixed], cs.cse([after, cs.horzcat(*seen)]))


@lru_cache(maxsize=1024)
def _per_unit(effects: Effects, term: str) -> Array:
    """What each parameter (P,) adds to a drive's shift or compliance, per unit."""
    theta = cs.SX.sym("theta", len(effects))
    drive = _drive(Law.POSITION, effects, theta, cs.SX.sym("u"), cs.SX.sym("rest", 6))
    value = cs.SX(0) if (made := getattr(drive, term)) is None else made
    return np.asarray(cs.DM(cs.densify(cs.jacobian(value, theta)))).reshape(-1)


@lru_cache(maxsize=1024)
def _planning(effects: Effects) -> frozenset[int]:
    """Which parameters shape a planned way, its command's time among that."""
    theta, state = cs.SX.sym("theta", len(effects)), cs.SX.sym("state", len(MEMORY))
    drive = _drive(Law.POSITION, effects, theta, cs.SX.sym("u"), cs.SX.sym("rest", 6))
    after = drive.step(Memory(*cs.vertsplit(state)))
    shaped = cs.vertcat(after.path, after.pace)
    found = np.asarray(cs.DM(cs.jacobian_sparsity(shaped, theta), 1.0)).any(axis=0)
    return frozenset(np.flatnonzero(found | (_per_unit(effects, "shift") != 0)).tolist())


def _drive(law: Law, effects: Effects, theta: cs.SX, command: cs.SX, rest: cs.SX) -> Drive:
    load, inertia, dt, kp, kd, bare = cs.vertsplit(rest)
    drive = Drive(law, dt, command, load, inertia, kp, kd, bare)
    for k, effect in enumerate(effects):
        drive = effect.apply(drive, theta[k])
    return drive


@lru_cache(maxsize=1024)
def _step(law: Law, effects: Effects, by: tuple[int, ...]) -> cs.Function:
    """``both, (u, du, du, load, inertia), (dt, kp, kd, bare, theta) -> next, output``."""
    names, P = _memory(effects), len(by)
    size = len(names)
    # The state, and its sensitivities by some parameters.
    both, data = cs.SX.sym("both", size * (1 + P)), cs.SX.sym("data", 5)
    fixed = cs.SX.sym("fixed", 4 + len(effects))
    theta, state = fixed[4:], both[:size]
    drive = _drive(law, effects, theta, data[0], cs.vertcat(data[3:], fixed[:4]))
    after = drive.step(Memory(*cs.vertsplit(state)))
    new = cs.vertcat(*(getattr(after, name) for name in names))
    if not by:
        return cs.Function("step", [both, data, fixed], cs.cse([cs.densify(new), new[3]]))
    S, some = cs.reshape(both[size:], size, P), list(by)
    if any(effect.plans for effect in effects):
        S[PLAIN:, :] = 0  # no slope is of a way
    S = cs.jacobian(new, state) @ S + cs.jacobian(new, theta)[:, some]
    late = np.array([_per_unit(effects, "shift"), [e.lags for e in effects]])[:, some]
    S += cs.jacobian(new, data[0]) @ (data[1:3].T @ late)
    S = cs.densify(S)
    told = [cs.vertcat(new, cs.reshape(S, size * P, 1)), cs.vertcat(new[3], S[3, :].T)]
    return cs.Function("step", [both, data, fixed], cs.cse([cs.densify(x) for x in told]))


def played(windows: Windows, effects: Effects, theta: Array) -> Array:
    """Positions (M,) [rad] along the whole recording, from the first window's measured start."""
    w, M = windows, len(windows.command)
    whole = replace(w, start=w.start[:1], length=M - 1, settle=0)
    shift = float(_per_unit(effects, "shift") @ theta)
    late = sum(e.lags * value for e, value in zip(effects, theta, strict=True))
    u, *_ = whole.asked(shift, whole.start, M - 1, float(late))
    at = int(w.start[0])
    size = len(_memory(effects))
    yields = float(_per_unit(effects, "compliance") @ theta)
    begin = _begun(w, u, np.array([at]), yields)[:size, 0]
    data = np.stack([u[0, 1:], *np.zeros((2, M - 1)), *w.loads(np.arange(at + 1, M))])
    fixed = np.array([w.dt, w.kp, w.kd, w.bare, *theta])
    steps = _step(w.drive, effects, ()).mapaccum("played", M - 1)  # not expanded: M may be large
    out = steps(begin, data, np.broadcast_to(fixed[:, None], (len(fixed), M - 1)))[1]
    return np.concatenate([[w.q[at]], np.asarray(out)[0]])

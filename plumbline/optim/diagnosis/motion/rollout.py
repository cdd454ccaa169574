r"""Roll-outs of a joint's drive over windows, with exact derivatives.

A row of the problem is a window: its commands, its measured start and H measured samples. With the
drive's step :math:`s' = f(s, u, \theta)`, sensitivities :math:`S = \partial s / \partial \theta`
are carried along,

.. math:: S' = f_s S + f_\theta + f_u\, \dot u(t - d)\, (-\partial d / \partial \theta),

the last term because commands are interpolated at :math:`t - d`: a delay is a number like any
other. The step is compiled once for a set of effects, of any joint and length (``mapaccum``), and
memory grows with the windows that are looked at together, not with the recording.
"""

from dataclasses import fields, replace
from functools import lru_cache
from typing import Any

import casadi as cs
import numpy as np

from plumbline.kinematics.drive import Drive, Memory
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.effects.velocity_limit import VelocityLimit
from plumbline.kinematics.law import Law
from plumbline.optim.diagnosis.motion.constants import (
    ABREAST,
    PIECE,
    PIECES,
    STRETCH,
    TOGETHER,
    WAYS,
    WIDE,
)
from plumbline.optim.diagnosis.motion.filtered import Filters, filtered, filters_of
from plumbline.optim.diagnosis.motion.windows import Array, Effects, Integers, Windows

MEMORY = tuple(field.name for field in fields(Memory))
# What lags has more, more what is told no faster, what plans all.
PLACE, SENT, PLAIN, PACE = (MEMORY.index(name) for name in ("place", "sent", "told", "pace"))


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
    given = tuple(range(len(theta))) if slopes else ()
    if not any(effect.plans for effect in effects):
        return _counted(w, _passed(w, effects, theta, given))
    # A planned way switches between full speed up and full braking: a small change moves every
    # later switch, so that derivatives grow without end where differences over a wide step do not.
    # What acts behind the way moves no switch.
    behind = tuple(k for k in given if k not in _planning(effects))
    there = _passed(w, effects, theta, behind)
    out = np.empty((*there.shape[:2], 1 + len(given)))
    out[..., [0, *(1 + k for k in behind)]] = there
    for k in set(given).difference(behind):
        # Values (P,) to either side: by a share of the width, or of a limit itself; in bounds
        p, size = effects[k].parameter, w.sizes(effects[k : k + 1])[0]
        step = WIDE * (abs(theta[k]) if p.null > p.scale else p.scale * size)
        low, high = np.array(theta), np.array(theta)
        low[k], high[k] = max(theta[k] - step, p.lower * size), min(theta[k] + step, p.upper * size)
        one_sided = rough and high[k] > theta[k]
        back = theta if one_sided else low
        near = there[..., 0] if one_sided else _passed(w, effects, low, ())[..., 0]
        with np.errstate(over="ignore", invalid="ignore"):  # where a way runs off, no step is taken
            slope = (_passed(w, effects, high, ())[..., 0] - near) / (high[k] - back[k])
        out[..., 1 + k] = np.where(np.isfinite(slope), slope, 0.0)
    return _counted(w, out)


def _counted(w: Windows, passed: Array) -> Array:
    """Of every sample of the roll-outs (R, steps, C) those that count (W, H - settle, C)."""
    begin, _, row = w.passes
    at = (row * passed.shape[1] + w.start - begin[row])[:, None] + np.arange(w.settle, w.length)
    each = passed.transpose(2, 0, 1).reshape(passed.shape[2], -1)
    return each.take(at, axis=1).transpose(1, 2, 0)


def _passed(w: Windows, effects: Effects, theta: Array, by: tuple[int, ...]) -> Array:
    """The same of every sample of the roll-outs (R, steps, 1 + B), by so many parameters."""
    begin = w.passes[0]
    shift, yields, sags = (per_unit(effects, term) for term in ("shift", "compliance", "sag"))
    lags = np.array([e.lags for e in effects])
    u, *du = w.asked(float(shift @ theta), float(lags @ theta), w.reach)
    now = _begun(w, u, begin, float(yields @ theta), float(sags @ theta))
    size = len(_memory(effects))
    state = np.zeros((len(begin), 1 + len(by), size))
    state[:, 0] = now[:size].T
    if any(effect.plans for effect in effects):
        u, du = _way(w, effects, theta, u, now), [np.zeros_like(u)] * 2  # it is as it is
    late = du[0][:, :1] * shift[list(by)] + du[1][:, :1] * lags[list(by)]
    for k in (k for k in (0, SENT, PLAIN) if k < size):  # what begins at a command is late
        state[:, 1:, k] = late
    if w.law.ideal:
        state[:, 1:, PLACE] = w.load[begin][:, None] * yields[list(by)]
        for k in (k for k in (0, SENT) if k < size):
            state[:, 1:, k] -= w.load[begin][:, None] * sags[list(by)]
    fixed = np.array([w.dt, w.kp, w.kd, w.bare, *theta])
    told = [x[:, 1:] for x in (u, *du)]
    if (filters := _filters(w.drive, effects, by)) is not None:
        data = (*told, *w.given.transpose(2, 0, 1))
        return filtered(filters, state.reshape(len(state), -1), data, fixed)
    given = np.concatenate([np.stack(told, axis=-1), w.given], axis=-1)
    return _stepped(w, _step(w.drive, effects, by), state.reshape(len(state), -1), given, fixed)


def _way(w: Windows, effects: Effects, theta: Array, u: Array, begun: Array) -> Array:
    """What a servo plans of its commands (R, steps + 1), from states as in MEMORY (8, R).

    It is the same whatever the drive does behind it, of which many are tried.
    """
    some = sorted(_planning(effects))
    shaping, state = tuple(effects[k] for k in some), np.ascontiguousarray(begun[PLAIN:].T)
    key = shaping, theta[some].tobytes(), u.tobytes(), state.tobytes()
    if key not in w.ways:
        if len(w.ways) == WAYS:
            w.ways.pop(next(iter(w.ways)))
        fixed = np.array([w.dt, *theta[some]])
        planned = _stepped(w, _plan(w.drive, shaping), state, u[:, 1:, None], fixed)
        w.ways[key] = np.concatenate([u[:, :1], planned[: len(u), : u.shape[1] - 1, 0]], axis=1)
    return w.ways[key]


def _stepped(w: Windows, step: cs.Function, state: Array, given: Array, fixed: Array) -> Array:
    """Outputs (R, steps, O) of a step, from where roll-outs begin (R, n), given so much (D,)."""
    (R, H, _), steps = given.shape, w.passes[1]
    abreast = 1 if w.law.follows else ABREAST
    pieces = PIECES if w.law.follows else -(-H // PIECE)
    call = pieces * PIECE
    data = np.ones((-(-R // abreast) * abreast, -(-H // call) * call, given.shape[2]))
    data[:R, :H] = given  # and else an inertia of one
    begun = np.zeros((len(data), state.shape[1]))
    begun[:R] = state
    every = np.tile(np.asarray(_apart(step)[0](fixed)).ravel(), (abreast * pieces, 1))
    after = np.empty((abreast, pieces, state.shape[1]))
    out = np.empty((*data.shape[:2], step.size1_out(1)))
    handle: Any = _rolling(step, pieces, abreast).buffer()  # addresses alone
    buffer, run = handle
    buffer.set_arg(2, every.data)
    buffer.set_res(0, after.data)
    for r in range(0, R, abreast):
        now = begun[r : r + abreast]
        buffer.set_arg(0, now.data)
        for k in range(0, int(steps[r]), call):
            buffer.set_arg(1, data[r : r + abreast, k : k + call].data)
            buffer.set_res(1, out[r : r + abreast, k : k + call].data)
            run()
            now[:] = after[:, -1]
    return out


@lru_cache(maxsize=1024)
def _filters(law: Law, effects: Effects, by: tuple[int, ...]) -> Filters | None:
    """A step and its sensitivities as filters, where nothing in it switches."""
    size, output = len(_memory(effects)), MEMORY.index("output")
    return filters_of(_step(law, effects, by), [size * k + output for k in range(1 + len(by))])


def _memory(effects: Effects) -> tuple[str, ...]:
    """What a drive with these effects keeps from sample to sample, behind a way that it plans."""
    plans = any(effect.plans for effect in effects)
    if any(isinstance(e, VelocityLimit) and e.told and not plans for e in effects):
        return MEMORY[:PACE]
    return MEMORY[: PLAIN if any(isinstance(e, ActuationLag) for e in effects) else SENT]


def _begun(w: Windows, u: Array, start: Integers, compliance: float, sag: float) -> Array:
    """States (8, w) in which windows begin, as in MEMORY: a planned way is where the joint is.

    A joint within its play stays where it began, which a single reading's noise would move. What
    follows positions without a plan is as fast as those, and its motor ahead of what it yields by.
    """
    now, q, speed = u[:, 0], (w.posture if w.law.follows else w.q)[start], w.speed[start]
    pace = (u[:, 1] - now) / w.dt if w.law.ideal else speed
    yields, off = (k * w.load[start] if w.law.ideal else 0.0 for k in (compliance, sag))
    asked, motor = now - off, q + yields
    return np.stack([asked, motor, pace, q, asked, now, motor + off, speed])


@lru_cache(maxsize=1024)
def _rolling(step: cs.Function, pieces: int, abreast: int) -> cs.Function:
    """So many windows abreast, over so many compiled pieces."""
    several = _piece(step).mapaccum("rolled", pieces)
    return several if abreast == 1 else several.map(abreast)


@lru_cache(maxsize=1024)
def _piece(step: cs.Function) -> cs.Function:
    """Samples in a row, of what is worked out before them."""
    step, seen = _apart(step)[1], list[cs.SX]()
    after = both = cs.SX.sym("both", step.size1_in(0))
    data, known = cs.SX.sym("data", step.size1_in(1), PIECE), cs.SX.sym("known", step.size1_in(2))
    for sample in cs.horzsplit(data):
        after, now = step(after, sample, known)
        seen.append(now)
    return cs.Function("piece", [both, data, known], [after, cs.horzcat(*seen)])


@lru_cache(maxsize=1024)
def _apart(step: cs.Function) -> tuple[cs.Function, cs.Function]:
    """What of a step goes by its fixed numbers alone, and the step given that."""
    inputs = [cs.SX.sym(step.name_in(k), step.size1_in(k)) for k in range(3)]
    asked = {"extract_trivial": True}
    told, names, found = cs.extract_parametric(step.call(inputs), inputs[2], asked)
    known = cs.vertcat(cs.SX.sym("one"), *names)  # for there may be nothing
    before = cs.Function("before", inputs[2:], [cs.vertcat(1, *found)])
    return before, cs.Function("given", [*inputs[:2], known], cs.cse(told))


@lru_cache(maxsize=1024)
def per_unit(effects: Effects, term: str) -> Array:
    """What each parameter (P,) adds to a drive's shift or compliance, per unit."""
    theta = cs.SX.sym("theta", len(effects))
    drive = drive_of(Law.POSITION, effects, theta, cs.SX.sym("u"), cs.SX.sym("rest", 6))
    value = cs.SX(0) if (made := getattr(drive, term)) is None else made
    return np.asarray(cs.DM(cs.densify(cs.jacobian(value, theta)))).reshape(-1)


@lru_cache(maxsize=1024)
def _planning(effects: Effects) -> frozenset[int]:
    """Which parameters shape a planned way, its command's time among that."""
    theta, state = cs.SX.sym("theta", len(effects)), cs.SX.sym("state", len(MEMORY))
    drive = drive_of(Law.POSITION, effects, theta, cs.SX.sym("u"), cs.SX.sym("rest", 6))
    shaped = cs.vertcat(*drive.planned(Memory(*cs.vertsplit(state))))
    found = np.asarray(cs.DM(cs.jacobian_sparsity(shaped, theta), 1.0)).any(axis=0)
    return frozenset(np.flatnonzero(found | (per_unit(effects, "shift") != 0)).tolist())


def drive_of(law: Law, effects: Effects, theta: cs.SX, command: cs.SX, rest: cs.SX) -> Drive:
    """A drive with these effects; the rest is load, inertia, dt, kp, kd, bare."""
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
    drive = drive_of(law, effects, theta, data[0], cs.vertcat(data[3:], fixed[:4]))
    if any(effect.plans for effect in effects):
        drive = drive.on_its_way(data[0])
    after = drive.step(Memory(*cs.vertsplit(state)))
    new = cs.vertcat(*(getattr(after, name) for name in names))
    if not by:
        return cs.Function("step", [both, data, fixed], cs.cse([cs.densify(new), new[3]]))
    S, some = cs.reshape(both[size:], size, P), list(by)
    S = cs.jacobian(new, state) @ S + cs.jacobian(new, theta)[:, some]
    late = np.array([per_unit(effects, "shift"), [e.lags for e in effects]])[:, some]
    S += cs.jacobian(new, data[0]) @ (data[1:3].T @ late)
    S = cs.densify(S)
    told = [cs.vertcat(new, cs.reshape(S, size * P, 1)), cs.vertcat(new[3], S[3, :].T)]
    return cs.Function("step", [both, data, fixed], cs.cse([cs.densify(x) for x in told]))


@lru_cache(maxsize=64)
def _plan(law: Law, shaping: Effects) -> cs.Function:
    """``(told, path, pace), command, (dt, theta) -> next, path``."""
    before, u, fixed = cs.SX.sym("before", 3), cs.SX.sym("u"), cs.SX.sym("fixed", 1 + len(shaping))
    rest = cs.vertcat(0, 1, fixed[0], cs.SX(3, 1))  # which no plan knows of
    drive = drive_of(law, shaping, fixed[1:], u, rest)
    nothing = [cs.SX(0)] * PLAIN
    path, pace = drive.planned(Memory(*nothing, *cs.vertsplit(before)))
    return cs.Function("plan", [before, u, fixed], [cs.vertcat(drive.command, path, pace), path])


def played(windows: Windows, effects: Effects, theta: Array) -> Array:
    """Positions (M,) [rad] along the whole recording, from its measured start."""
    w, u = _whole(windows, effects, theta)
    yields, sags = (float(per_unit(effects, term) @ theta) for term in ("compliance", "sag"))
    begun = _begun(w, u, w.start, yields, sags)
    if any(effect.plans for effect in effects):
        u = _way(w, effects, theta, u, begun)
    begin = begun[: len(_memory(effects)), 0]
    data = np.stack([u[0, 1:], *np.zeros((2, w.length)), *w.loads(np.arange(1, w.length + 1))])
    fixed = np.array([w.dt, w.kp, w.kd, w.bare, *theta])
    return np.append(w.q[0], _along(_step(w.drive, effects, ()), begin, data, fixed))


def _whole(windows: Windows, effects: Effects, theta: Array) -> tuple[Windows, Array]:
    """A whole recording as one window, and the commands (1, M) that reach its drive."""
    w = replace(windows, start=np.zeros(1, np.int64), length=len(windows.command) - 1, settle=0)
    shift = float(per_unit(effects, "shift") @ theta)
    late = sum(e.lags * value for e, value in zip(effects, theta, strict=True))
    return w, w.asked(shift, float(late), w.reach_of(w.start, w.length))[0]


def pushed(windows: Windows, effects: Effects, theta: Array) -> Array:
    """Torques (M - 1,) [N m] that a drive gives its bodies over each sample, friction taken off.

    Along where the joint was, as measured; of a drive that pushes. What a largest speed takes is
    not told by it: of what goes at that speed, noise alone would be a torque.
    """
    kept = [k for k, e in enumerate(effects) if e.term != "fastest"]
    effects, theta = tuple(effects[k] for k in kept), np.asarray(theta)[kept]
    w, u = _whole(windows, effects, theta)
    load, inertia = w.loads(np.arange(1, w.length + 1))
    moved = w.posture[:-1], w.speed[:-1]
    data = np.stack([u[0, 1:], *np.zeros((2, w.length)), load, inertia, *moved])
    fixed = np.array([w.dt, w.kp, w.kd, w.bare, *theta])
    begin = _begun(w, u, w.start, 0.0, 0.0)[: len(_memory(effects)), 0]
    return inertia * _along(_pushing(w.drive, effects), begin, data, fixed) / w.dt + load


def _along(step: cs.Function, now: Array, data: Array, fixed: Array) -> Array:
    """What a step gives of every sample (M,) of one long run, a stretch of samples a call."""
    stretch, out = step.mapaccum("along", STRETCH), []
    for part in np.split(data, range(STRETCH, data.shape[1], STRETCH), axis=1):
        count = part.shape[1]
        steps = stretch if count == STRETCH else step.mapaccum("along", count)
        after, told = steps(now, part, np.broadcast_to(fixed[:, None], (len(fixed), count)))
        now = np.asarray(after[:, -1])
        out.append(np.asarray(told)[0])
    return np.concatenate(out)


@lru_cache(maxsize=1024)
def _pushing(law: Law, effects: Effects) -> cs.Function:
    """``state, (u, du, du, load, inertia, place, speed), fixed -> next, what speed it gains``."""
    step, names = _step(law, effects, ()), _memory(effects)
    state, data = cs.SX.sym("state", len(names)), cs.SX.sym("data", 7)
    fixed = cs.SX.sym("fixed", 4 + len(effects))
    now = cs.vertcat(state[0], data[5:], state[3:])  # where it was measured
    after = step(now, data[:5], fixed)[0]
    return cs.Function("pushing", [state, data, fixed], [after, after[2] - data[6]])

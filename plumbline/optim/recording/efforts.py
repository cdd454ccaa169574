r"""Efforts of drives: their unit, the motion that they go with, and their noise.

.. math:: \tau = k_t\, i, \qquad \sigma_i^2 = \mathrm{median}\,
          \left(\tau_i - X_i \hat\theta_i\right)^2 / 0.455

Joints of one arm differ in noise by an order of magnitude, so each is weighed by its own: as stated
(``noise_std`` of ``[motion]``, or of the recording), else as what a generous straight-line fit of
all that a joint's effort may depend on leaves of it.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import casadi as cs
import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import gammaincinv

from plumbline.errors import fault, shown
from plumbline.kinematics.constants import STANDARD_GRAVITY
from plumbline.kinematics.dynamics import Dynamics
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import constant
from plumbline.kinematics.tree import dynamics_of_chain, laden
from plumbline.optim.core.quantities import counted, quantity
from plumbline.optim.recording import constants
from plumbline.optim.recording.derivatives import derived_motion, elsewhere, turning, velocity_noise
from plumbline.optim.recording.filtered_efforts import Channel
from plumbline.optim.recording.late import at_other_time, basis_of, late_by, likeliest
from plumbline.optim.recording.mixed_up import refuse_mixed_up, refuse_other_rates
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.sensor_end import without_saturated
from plumbline.optim.recording.table import Array, Flags, Origin
from plumbline.optim.rigid import some_of

RATES = ("velocity", "acceleration")


def with_motion(r: Recording, origin: Origin) -> Recording:
    """With velocities, accelerations, senses of turning and the efforts' noise (PlumblineError)."""
    if not r.chain.has_masses:
        mend = "give a URDF with <inertial>, or record another kind of observation"
        raise fault(origin.key("[robot]"), "a robot without masses", "masses, for torques", mend)
    r = _run_by_run(r)
    refuse_other_rates(r, origin)
    velocity, notes = r.velocity, r.notes
    acceleration, shaken = r.acceleration, np.zeros(r.chain.n)
    left, placed = np.zeros(r.chain.n), None
    if acceleration is None or velocity is None:
        motion = derived_motion(r.q, velocity, r.time, origin)
        if velocity is not None and acceleration is None:
            places = derived_motion(r.q, None, r.time, origin)
            placed = places.velocity
            if (places.acceleration_noise <= motion.acceleration_noise).all():
                motion, velocity, placed = places, None, None
                notes = (*notes, "velocities are told by positions, with less noise than as read")
        smooth, left = motion.velocity, motion.velocity_noise
        shaken = motion.acceleration_noise if acceleration is None else shaken
        acceleration = motion.acceleration if acceleration is None else acceleration
        notes = (*notes, motion.note)
    else:
        smooth = velocity
    slow = velocity_noise(velocity, smooth, left)
    always = tuple(word for word in r.always if word not in ("frame", "tool"))
    r = replace(
        r, velocity=smooth, acceleration=acceleration, turning=turning(smooth, slow), notes=notes,
        always=always, measured_joints=tuple(range(r.chain.n)),
    )  # fmt: skip
    r = efforts_within_ends(in_time(r, placed, slow))
    refuse_strange(r, origin)
    noise, said = _scattered(r, _noise_by_joint(r, shaken, origin))
    stated = r.noise_by_joint is not None or r.noise_std is not None
    whole = float(np.sqrt(np.mean(noise**2))) if stated else None
    return replace(r, noise_by_joint=noise, noise_std=whole, notes=(*r.notes, *said))


def _run_by_run(r: Recording) -> Recording:
    """With gaps in time between logs that lie back to back: where joints are elsewhere at once."""
    begins = elsewhere(r.q) if len(r) > 1 else np.zeros(0, bool)
    if r.time is None or not begins.any():
        return r
    gap = 2.0 * constants.GAP_IN_TIME * np.median(np.abs(np.diff(r.time)))
    times = counted(int(begins.sum()), "time")
    said = f"joints are elsewhere at once {times}: motions of their own"
    time = r.time + gap * np.append(0.0, np.cumsum(begins))
    return replace(r, time=time, notes=(*r.notes, said))


def in_time(r: Recording, placed: Array | None, slow: Array) -> Recording:
    """All channels at one time, where velocities or efforts are read late; rows without any go.

    ``placed`` (N, n) are velocities by positions alone, if asked; ``slow`` (n,) their noise.
    """
    time, ones = r.time, np.ones(len(r))
    if time is None:
        return r
    if placed is not None and r.velocity is not None:
        own = [np.column_stack([v, ones]) for v in placed.T]
        late = late_by(time, r.velocity, lambda rows: [basis_of(X[rows]) for X in own])
        said = f"velocities are read {1e3 * late:.3g} ms after positions"
        r = _taken_back(r, RATES, late, said, slow)
        time = r.time if r.time is not None else time
    late = late_by(time, r.measured, lambda rows: _designs(r, rows))
    if late > 0.0:  # as what passes a filter is
        r = _unfiltered(r, late, slow)
        late = late_by(time, r.measured, lambda rows: _designs(r, rows))
    for _ in range(constants.AGAIN if late else 0):  # what a row blurs is sharper from near by
        near = _taken_back(r, ("q", *RATES), -late, "", slow)
        clock = time if near.time is None else near.time
        late += likeliest(clock, near.measured, partial(_designs, near))[0]
        late = float(np.clip(late, -constants.LATEST, constants.LATEST))
    said = f"efforts are read {1e3 * late:.3g} ms after positions"
    return _taken_back(r, ("q", *RATES), -late, said, slow)


def _unfiltered(r: Recording, late: float, slow: Array) -> Recording:
    """With efforts that are so late [s] as they were before a filter, if they surely passed one."""
    assert r.time is not None

    def columns(rows: NDArray[np.integer], less: float, late: float) -> list[Array]:
        return _columns(_moved(r, ("q", *RATES), less - late, slow)[0], rows)

    T, own, stated = 0.0, r.noise_by_joint, r.noise_std
    for _ in range(2):  # what a row blurs is sharper from near by
        channel = Channel(r.time, r.measured, partial(columns, late=late))
        if not (T := channel.filter_time()):
            return r
        late += channel.off(T)
    read, louder = channel.before(T)
    note = f"efforts passed a filter of first order, of {1e3 * T:.3g} ms: undone"
    return replace(
        r, measured=read, noise_by_joint=None if own is None else louder * own,
        noise_std=None if stated is None else louder * stated, notes=(*r.notes, note),
    )  # fmt: skip


def _taken_back(r: Recording, names: Sequence[str], by: float, said: str, slow: Array) -> Recording:
    """With columns of so much later [s], in rows that have any."""
    if not by or r.time is None:
        return r
    found, there = _moved(r, names, by, slow)
    note = f"{said}: taken back by as much"
    return replace(found, notes=(*r.notes, note)).select(there)


def _moved(r: Recording, names: Sequence[str], by: float, slow: Array) -> tuple[Recording, Flags]:
    """The same in all rows, and which of them (N,) have any."""
    assert r.time is not None
    moved = {name: at_other_time(r.time, getattr(r, name), by) for name in names}
    columns: dict[str, Any] = {name: found for name, (found, _) in moved.items()}
    r = replace(r, **columns)
    return replace(r, turning=turning(motion_of(r)[0], slow)), moved[names[0]][1]


def efforts_within_ends(r: Recording) -> Recording:
    """Without rows in which a sensor reads its end."""
    return without_saturated(r, nominal_efforts(r), partial(_columns, r))


def nominal_efforts(r: Recording, gravity: tuple[float, ...] | None = None) -> Array:
    """Efforts (N, n) [N m or N] of the model alone and a recorded payload, in a gravity (3,)."""
    return _under(r, gravity).torques(r.q, *motion_of(r)) + payload_efforts(r, gravity)


def payload_efforts(r: Recording, gravity: tuple[float, ...] | None = None) -> Array:
    """What the payload that was recorded, at the tool's tip, asks for of that (N, n) [N m or N]."""
    if r.payload is None or not r.payload.any():
        return np.zeros(r.q.shape)
    dynamics = _under(r, gravity)
    kilogram = cs.evalf(laden(r.chain, 1.0, constant(r.tool_offset))).full() - dynamics.inertial
    return r.payload[:, None] * replace(dynamics, inertial=kilogram).torques(r.q, *motion_of(r))


def _under(r: Recording, gravity: tuple[float, ...] | None) -> Dynamics:
    dynamics = dynamics_of_chain(r.chain)
    return dynamics if gravity is None else replace(dynamics, gravity=np.array(gravity))


def motion_of(r: Recording) -> tuple[Array, Array]:
    """Velocities and accelerations (N, n) of efforts, which are made with the recording."""
    assert r.velocity is not None
    assert r.acceleration is not None
    return r.velocity, r.acceleration


def refuse_strange(r: Recording, origin: Origin) -> None:
    """Refuse efforts of another joint, against their joint, without signs, or of another set-up.

    One that nothing drives, or that is not read, is fitted best by bodies of no mass.
    """
    if len(r) < constants.FEWEST_EFFORTS:
        return
    model = nominal_efforts(r)
    for one in np.flatnonzero((np.ptp(r.measured, axis=0) == 0.0) & (np.ptp(model, axis=0) > 0.0)):
        found = f"{shown(float(r.measured[0, one]))} in every row, where the model's change"
        mend = "if the joint has no drive or none is read, end at a [robot] tip_frame before it"
        raise fault(origin.at(f"effort{one + 1}"), found, "efforts that change", mend)
    large = np.abs(model) >= np.median(np.abs(model), axis=0)
    low, high = constants.CHANGES
    changes = [low < (model[large[:, j], j] > 0).mean() < high for j in range(r.chain.n)]
    positive = (r.measured >= 0).mean(axis=0) >= constants.UNSIGNED
    bare = [j for j in range(r.chain.n) if changes[j] and positive[j] and r.measured[:, j].any()]
    if bare and len(bare) >= 0.5 * sum(changes):
        j = bare[0]
        found = f"efforts from {shown(float(r.measured[:, j].min()))} up, where the model's change"
        mend = "record them with their sign: a size alone does not say which way a drive works"
        raise fault(origin.at(f"effort{j + 1}"), f"{found} sign", "efforts with signs", mend)
    refuse_other_set_up(r, origin)
    refuse_mixed_up(model, r.measured, ("the model's effort", "effort"), origin)


def refuse_other_set_up(r: Recording, origin: Origin) -> None:
    """Refuse efforts that another mounting or another unit explains far better, given friction.

    A rotor makes a multiple of what moves the bodies, never of what holds their weight.
    """
    r = r.select(some_of(len(r), constants.INERTIA_ROWS))
    read, model = r.measured, nominal_efforts(r)
    tried = _under_each(r, _mountings(r))
    each, against = _off(r, read - model), _off(r, -read - model)
    own, turned = float(each.mean()), float(against.mean())
    left, gravity = min((float(_off(r, read - m).mean()), g) for g, m in tried.items())
    best = scipy.optimize.minimize_scalar(lambda k: _off(r, read - k * model).mean())
    factor, scaled = float(best.x), float(best.fun)
    moved = tried[0.0, 0.0, 0.0]
    heavy = np.sum((model - moved) ** 2) > np.sum(moved**2)
    read_square, many = float(np.mean(read**2)), constants.MIXED_UP
    # Of drives that read next to nothing no mounting explains what they read; nor are signs alone.
    mounted = many * left < min(own, read_square) and left < turned
    far = not 1 / constants.NEAR_SCALE < factor < constants.NEAR_SCALE
    unit = factor > 0.0 and far and many * scaled < min(own, many * left)
    if heavy and (unit or (not mounted and many * read_square < own)):
        times = factor if unit else np.sqrt(read_square / np.mean(model**2))
        mend = 'divide by 1000 if in N mm, or write effort_unit = "A" with torque_constant'
        raise fault(origin.at("effort1"), f"efforts {times:.3g} times the model's", "N m", mend)
    if mounted:
        found = f"efforts {own**0.5:.2g} N m off the model, {left**0.5:.2g} with another gravity"
        off = "" if any(gravity) else ": the controller takes the arm's weight off"
        where, mend = origin.key("[robot] gravity"), f"write gravity = {list(gravity)}{off}"
        raise fault(where, found, "the gravity of this mounting", mend)
    for one in np.flatnonzero(many * against < each):
        found = f"effort{one + 1} against the model's and its friction"
        mend = "turn the sign of this column"
        raise fault(origin.at(f"effort{one + 1}"), found, "efforts that run with them", mend)


def _off(r: Recording, read: Array) -> Array:
    """Mean squares (n,) of what is left of efforts (N, n) given friction of each joint.

    It goes with the sense of turning and the speed, and is never below nothing.
    """
    assert r.turning is not None
    columns = zip(r.turning.T, motion_of(r)[0].T, read.T, strict=True)
    return np.array(
        [scipy.optimize.nnls(np.stack(c[:2], axis=1), c[2])[1] ** 2 / len(read) for c in columns]
    )


def _mountings(r: Recording) -> list[tuple[float, ...]]:
    """Gravities (3,) of a robot that hangs, or is on a wall, and of one whose weight is borne."""
    g = np.asarray(r.chain.gravity, dtype=float)
    size = float(np.linalg.norm(g)) or float(np.linalg.norm(STANDARD_GRAVITY))
    ways = [size * sign * axis for axis in np.eye(3) for sign in (-1.0, 1.0)]
    others = [np.zeros(3), *(way for way in ways if way @ g < size**2 / 2)]
    return [tuple((way.round(3) + 0.0).tolist()) for way in others]


def _under_each(
    r: Recording, gravities: Sequence[tuple[float, ...]]
) -> dict[tuple[float, ...], Array]:
    """Efforts (N, n) [N m or N] of the model alone under each: they are linear in gravity."""
    weightless = nominal_efforts(r, (0.0, 0.0, 0.0))
    ways = [nominal_efforts(r, tuple(way)) - weightless for way in np.eye(3).tolist()]
    return {g: weightless + np.tensordot(g, ways, axes=1) for g in gravities}


def _noise_by_joint(r: Recording, shaken: Array, origin: Origin) -> Array:
    """Noise (n,) as stated, else as estimated on rows that may be fitted.

    A stated one is the reading's own. What noise is left in derived accelerations (n,) moves the
    bodies' torque besides, by as much as the inertia has it.
    """
    n = r.chain.n
    if r.noise_by_joint is not None or r.noise_std is not None:
        own = np.full(n, r.noise_std) if r.noise_by_joint is None else r.noise_by_joint
        if not (own > 0.0).all():
            least = shown(float(own.min()))
            mend = "give 1 sigma in N m, or leave it out: then it is estimated"
            raise fault(origin.key("noise_std"), least, "more than 0 N m", mend)
        return np.asarray(np.hypot(own, _shaken_torques(r, shaken)))
    rows = np.arange(len(r)) if r.held_out is None else np.flatnonzero(~r.held_out)
    rows = rows[some_of(len(rows), constants.EFFORT_ROWS)]
    return np.array([_left_over(r, rows, X, j) for j, X in enumerate(_designs(r, rows))])


def _scattered(r: Recording, noise: Array) -> tuple[Array, list[str]]:
    """Noise (n,) as efforts scatter from row to row where that is far more than stated; notes.

    Third differences of what a generous straight-line fit leaves know nothing of what is smooth.
    """
    stated = r.noise_by_joint is not None or r.noise_std is not None
    rows = np.arange(len(r)) if r.held_out is None else np.flatnonzero(~r.held_out)
    rows = rows[: constants.EFFORT_ROWS]
    if not stated or r.time is None or len(rows) < constants.FEWEST_EFFORTS:
        return noise, []
    left = r.measured[rows] - nominal_efforts(r.select(rows))
    rest = [y - X @ (X.T @ y) for y, X in zip(left.T, _designs(r, rows), strict=True)]
    rough = np.median(np.abs(np.diff(rest, 3)), axis=1) / constants.THIRD_DIFFERENCE
    belied = rough > constants.BELIED * noise
    said = [
        f"efforts of joint {j + 1} scatter by {quantity(rough[j], 'N m' if turns else 'N')} from "
        f"row to row, {rough[j] / noise[j]:.3g} times the stated noise: taken for their noise"
        for j, turns in enumerate(r.chain.turning)
        if belied[j]
    ]
    return np.where(belied, rough, noise), said


def _shaken_torques(r: Recording, shaken: Array) -> Array:
    """Torques (n,) that noise of the accelerations (n,) makes [N m or N], 1 sigma."""
    rows = some_of(len(r), constants.INERTIA_ROWS)
    q, still, n = r.q[rows], np.zeros((len(rows), r.chain.n)), r.chain.n
    dynamics = dynamics_of_chain(r.chain)
    rest = dynamics.torques(q, still, still)
    each = [
        dynamics.torques(q, still, still + s * e) - rest
        for s, e in zip(shaken, np.eye(n), strict=True)
    ]
    return np.asarray(np.sqrt(np.mean(np.sum(np.square(each), axis=0), axis=0)))


def _designs(r: Recording, rows: NDArray[np.integer]) -> list[Array]:
    """Orthonormal columns (k, p) of all that each joint's effort may depend on."""
    return [basis_of(X) for X in _columns(r, rows)]


def _columns(r: Recording, rows: NDArray[np.integer]) -> list[Array]:
    """These columns (k, P) as they are."""
    v, a = (part[rows] for part in motion_of(r))
    assert r.turning is not None
    sense, q = r.turning[rows], r.q[rows]
    dynamics = dynamics_of_chain(r.chain)
    Y = over_rows(dynamics.regressor_function, np.hstack([q, v, a]))[0]
    model, found = nominal_efforts(r.select(rows)), []
    for j in range(r.chain.n):
        turned, carried = sense[:, j], model[:, j]
        speed = np.sqrt(np.abs(v[:, j]))
        own = [turned, v[:, j], speed * turned, np.abs(carried) * turned, a[:, j], q[:, j], carried]
        found.append(np.column_stack([Y[:, :, j], *own, np.ones(len(q))]))
    return found


def _left_over(r: Recording, rows: NDArray[np.integer], basis: Array, j: int) -> float:
    """What a generous straight-line fit leaves of joint j's effort, robustly [N m or N]."""
    effort = r.measured[rows, j]
    # Of few rows the main directions alone, no more than half as many: the rest must tell noise.
    basis = basis[:, : len(rows) // 2]
    left = effort - nominal_efforts(r.select(rows))[:, j]
    left = left - basis @ (basis.T @ left)
    freedom = len(rows) - basis.shape[1]
    middle = 2.0 * float(gammaincinv(0.5, 0.5))  # median of a square of variance one
    square = float(np.median(left**2)) / middle * len(rows) / max(freedom, 1)
    least = constants.LEAST_EFFORT_NOISE * max(float(np.abs(effort).max()), 1.0)
    return max(float(np.sqrt(square)), least)

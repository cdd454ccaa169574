r"""Roll-outs of a joint's drive over windows, with exact derivatives.

A row of the problem is a window: its commands, its measured start and H measured samples. With the
drive's step :math:`s' = f(s, u, \theta)`, sensitivities :math:`S = \partial s / \partial \theta`
are carried along,

.. math:: S' = f_s S + f_\theta + f_u\, \dot u(t - d)\, (-\partial d / \partial \theta),

the last term because commands are interpolated at :math:`t - d`: a delay is a number like any
other. The step is compiled once for a set of effects, of any joint (``mapaccum``), and memory
grows with the windows that are looked at together, not with the recording.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.drive import Drive, Law, Memory
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.optim.diagnosis.motion.constants import OPEN

Array = NDArray[np.float64]
Effects = tuple[MotionEffect, ...]
MEMORY = tuple(field.name for field in fields(Memory))
SENT, PLAIN = MEMORY.index("sent"), MEMORY.index("told")  # what lags has more, what plans all
TOGETHER = 256  # windows that are rolled out at once: some 50 MB


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of one joint, all of one length.

    Attributes:
        law: What the joint's command is.
        dt: Time from sample to sample [s].
        kp: Known gain [N m/rad]; zero if there is none.
        kd: Known damping [N m s/rad].
        command: Commands of the joint's whole recording (N,).
        first: Where in it the run of each sample begins (N,): no command is older.
        q: Measured positions (N,) [rad].
        speed: Measured speeds (N,) [rad/s].
        load: Torque of gravity and of the other joints (N,) [N m].
        inertia: Inertia about the joint (N,) [kg m^2].
        start: Sample at which each window starts (W,).
        length: Samples after it (H).
        settle: How many of those do not count, since what nobody measured settles in them.
        size: What a radian is in the unit of ``q``.
        push: What a newton metre of command is in this joint's usual ones.
    """

    law: Law
    dt: float
    kp: float
    kd: float
    command: Array
    first: NDArray[np.int64]
    q: Array
    speed: Array
    load: Array
    inertia: Array
    start: NDArray[np.int64]
    length: int
    settle: int
    size: float = 1.0
    push: float = 1.0

    def __len__(self) -> int:
        """How many windows there are."""
        return len(self.start)

    @property
    def samples(self) -> NDArray[np.int64]:
        """Indices of the samples that count (W, H - settle)."""
        return self.start[:, None] + np.arange(self.settle + 1, self.length + 1)

    @property
    def measured(self) -> Array:
        """What was measured there (W, H - settle) [rad]."""
        return self.q[self.samples]

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
        if self.law != Law.SERVO and not self.law.pushes:
            return self.load[at], self.inertia[at]
        return (self.load[at] + self.load[at - 1]) / 2, (
            self.inertia[at] + self.inertia[at - 1]
        ) / 2

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

    def asked(self, shift: float, part: slice) -> tuple[Array, Array]:
        """Commands (w, H + 1) as obeyed so much later [s], and their derivatives by that."""
        at = self.start[part, None] + np.arange(self.length + 1)
        if self.law.holds:  # what stood over the sample before this one
            shift = shift + self.dt
        place = np.maximum(at - shift / self.dt, self.first[at])
        low = np.minimum(np.floor(place).astype(np.int64), len(self.command) - 2)
        slope = self.command[low + 1] - self.command[low]
        slope[self.first[low + 1] > low] = 0.0  # the next run's command is not this one's
        return self.command[low] + (place - low) * slope, -slope / self.dt


def roll_out(windows: Windows, effects: Effects, theta: Array) -> tuple[Array, Array]:
    """Predicted positions (W, H - settle) [rad] and their derivatives (W, H - settle, P)."""
    found = []
    for k in range(0, len(windows), TOGETHER):
        found.append(_rolled(windows, effects, theta, slice(k, k + TOGETHER)))
    if not found:
        empty = np.empty((0, windows.length - windows.settle))
        return empty, np.empty((*empty.shape, len(theta)))
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def _rolled(windows: Windows, effects: Effects, theta: Array, part: slice) -> tuple[Array, Array]:
    w, H, P = windows, windows.length, len(theta)
    shift = _shift(effects)(theta)
    late, by = float(shift[0]), np.array(shift[1]).reshape(P)
    u, du = w.asked(late, part)
    n, start = len(u), w.start[part]
    data = np.empty((4, n, H))
    data[0], data[1] = u[:, 1:], du[:, 1:]
    at = start[:, None] + np.arange(1, H + 1)
    data[2], data[3] = w.loads(at)
    size = len(_memory(effects))
    begin = np.zeros((size * (1 + P), n))
    begin[:size] = _begun(w, u, start)[:size]
    for k in (k for k in (0, SENT, PLAIN) if k < size):  # what begins at a command begins later
        begin[size + k :: size] = np.outer(by, du[:, 0])
    fixed = np.array([w.dt, w.kp, w.kd, *theta])
    fixed = np.broadcast_to(fixed[:, None], (len(fixed), n * H))
    out = _rolling(w.law, effects, H, n)(begin, data.reshape(4, n * H), fixed)[1]
    out = np.asarray(out).reshape(1 + P, n, H)[:, :, w.settle :]
    return out[0], np.moveaxis(out[1:], 0, -1)


def _memory(effects: Effects) -> tuple[str, ...]:
    """What a drive with these effects keeps from sample to sample."""
    if any(effect.plans for effect in effects):
        return MEMORY
    return MEMORY[: PLAIN if any(isinstance(e, ActuationLag) for e in effects) else SENT]


def _begun(w: Windows, u: Array, start: NDArray[np.int64]) -> Array:
    """States (8, w) in which windows begin, as in MEMORY: a planned way is where the joint is."""
    now, q, speed = u[:, 0], w.q[start], w.speed[start]
    return np.stack([now, q, speed, q, now, now, q, speed])


@lru_cache(maxsize=256)
def _rolling(law: Law, effects: Effects, length: int, windows: int) -> cs.Function:
    return _step(law, effects).mapaccum("rolled", length).expand().map(windows)


@lru_cache(maxsize=1024)
def _shift(effects: Effects) -> cs.Function:
    """``theta (P,) -> shift, its gradient (1, P)``."""
    theta = cs.SX.sym("theta", len(effects))
    drive = _drive(Law.POSITION, effects, theta, cs.SX.sym("u"), cs.SX.sym("rest", 5))
    shift = cs.SX(0) if drive.shift is None else drive.shift
    return cs.Function("shift", [theta], [shift, cs.densify(cs.jacobian(shift, theta))])


def _drive(law: Law, effects: Effects, theta: cs.SX, command: cs.SX, rest: cs.SX) -> Drive:
    load, inertia, dt, kp, kd = cs.vertsplit(rest)
    drive = Drive(law, dt, command, load, inertia, kp, kd)
    for k, effect in enumerate(effects):
        drive = effect.apply(drive, theta[k])
    return drive


@lru_cache(maxsize=1024)
def _step(law: Law, effects: Effects) -> cs.Function:
    """``state and sensitivities, (u, du, load, inertia), (dt, kp, kd, theta) -> next, output``."""
    P, names = len(effects), _memory(effects)
    size = len(names)
    both, data = cs.SX.sym("both", size * (1 + P)), cs.SX.sym("data", 4)
    fixed = cs.SX.sym("fixed", 3 + P)
    theta, state = fixed[3:], both[:size]
    S = cs.reshape(both[size:], size, P)
    drive = _drive(law, effects, theta, data[0], cs.vertcat(data[2:], fixed[:3]))
    after = drive.step(Memory(*cs.vertsplit(state)))
    new = cs.vertcat(*(getattr(after, name) for name in names))
    shift = cs.SX(0) if drive.shift is None else drive.shift
    S = cs.jacobian(new, state) @ S + cs.jacobian(new, theta)
    S += cs.jacobian(new, data[0]) @ (data[1] * cs.jacobian(shift, theta))
    S = cs.densify(S)
    following = cs.vertcat(new, cs.reshape(S, size * P, 1))
    seen = cs.vertcat(new[3], S[3, :].T)
    return cs.Function("step", [both, data, fixed], [cs.densify(following), cs.densify(seen)])


def played(windows: Windows, effects: Effects, theta: Array) -> Array:
    """Positions (M,) [rad] along the whole recording, from the first window's measured start."""
    w, M = windows, len(windows.command)
    whole = replace(w, start=w.start[:1], length=M - 1, settle=0)
    shift = float(_shift(effects)(theta)[0])
    u, _ = whole.asked(shift, slice(0, 1))
    at = int(w.start[0])
    size = len(_memory(effects))
    begin = np.zeros(size * (1 + len(theta)))
    begin[:size] = _begun(w, u, np.array([at]))[:size, 0]
    data = np.stack([u[0, 1:], np.zeros(M - 1), *w.loads(np.arange(at + 1, M))])
    fixed = np.array([w.dt, w.kp, w.kd, *theta])
    steps = _step(w.law, effects).mapaccum("played", M - 1)  # not expanded: M may be large
    out = steps(begin, data, np.broadcast_to(fixed[:, None], (len(fixed), M - 1)))[1]
    return np.concatenate([[w.q[at]], np.asarray(out)[0]])

r"""What all joints together tell of masses that a file lacks: least squares, and the evidence.

Where joints were and how they moved, torques beyond those of the file are linear in a body's
numbers p (:mod:`~plumbline.optim.diagnosis.motion.carried`): :math:`Y(q, \dot q, \ddot q)\, p`. A
joint of inertia :math:`J_j` that is not told of them is missed by

.. math:: \iint \frac{Y_j\, p}{J_j}\, dt^2

so that one pass over a recording has the columns of every body on the way to the tip. Each joint is
weighed by what it is missed by itself: one that is wrong for a reason of its own hardly counts,

.. math:: \max_p \; -\sum_j \frac{n_j}{2} \log s_j(p)

(noise integrated out), by weights :math:`n_j / s_j` again and again. What its drive was found to do
gives way (Schur).
"""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.kinematics.effects.link_inertia import LinkInertia, size_of
from plumbline.kinematics.effects.payload import CarriedMass
from plumbline.kinematics.oracle import pin
from plumbline.optim.diagnosis.motion.carried import Carried, model_of, tip_of
from plumbline.optim.diagnosis.motion.constants import BODY, ENOUGH, ITERATIONS
from plumbline.optim.diagnosis.motion.fit import correlation_time, evaluated
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.signals import Integers, Signals
from plumbline.optim.diagnosis.motion.windows import Array, Drives
from plumbline.optim.diagnosis.prior import FINEST


@dataclass(frozen=True, eq=False)
class Told:
    """What one joint's windows tell of a mass.

    Attributes:
        residual: Predicted minus measured (W, K) [rad].
        own: Derivatives by what its drive does, in widths of the priors (W K, P) [rad].
        mass: By numbers of the bodies on the way to the tip (W K, 10 B).
        late: By a delay (W K,) [rad/s].
    """

    residual: Array
    own: Array
    mass: Array
    late: Array

    def left(self, shift: Array, late: float = 0.0) -> Array:
        """Its residual (W, K) [rad] with other numbers, what its drive does giving way."""
        r = self.residual.ravel() + self.mass @ shift + late * self.late
        if self.own.shape[1] and np.isfinite(r).all():
            r = r - self.own @ np.linalg.lstsq(self.own, r, rcond=None)[0]
        return r.reshape(self.residual.shape)

    def sums(
        self, slopes: Array, residual: Array, weight: float, *, clock: bool
    ) -> tuple[Array, Array]:
        """Precision (P + 1, P + 1) and pull (P + 1,) of mass and lateness, so much a sample."""
        columns = np.column_stack([self.mass @ slopes, clock * self.late])
        A = weight * columns.T @ columns
        b = weight * columns.T @ residual.ravel()
        if self.own.shape[1]:
            cross = weight * self.own.T @ columns
            H = weight * self.own.T @ self.own + np.eye(self.own.shape[1])
            A = A - cross.T @ np.linalg.solve(H, cross)
        return A, b


class Telling:
    """What all joints tell of a mass, at states that were found with one that may be none."""

    def __init__(self, signals: Signals, drives: Drives, starts: Integers) -> None:
        self.signals, self.recording = signals, signals.recording
        self.path = path_of(self.recording)
        # Samples (R,) of windows, and torques there by numbers of bodies (R, n, 10 B).
        rows = np.unique(starts[:, None] + np.arange(signals.length + 1))
        columns = _columns(signals, rows, self.path)
        told = partial(self._told, starts, rows, columns)
        self.joints = tuple(told(j, drives[j]) for j in range(self.recording.n))

    def _told(self, starts: Integers, rows: Integers, columns: Array, j: int, drive: Any) -> Told:
        (effects, theta), w = drive, self.signals.windows(j, starts)
        P = len(effects)
        asked, values = (*effects, ActuationDelay()), np.append(theta, 0.0)
        if any(e.name == ActuationDelay.name for e in effects):
            asked, values = effects, theta
        fit = evaluated(w, asked, values)
        late = fit.flat[:, P] if len(asked) > P else np.zeros(fit.residual.size)
        rotor = sum(v for e, v in zip(effects, theta, strict=True) if e.term == "rotor")
        pushes = -columns[:, j] / (w.inertia[rows] + rotor)[:, None]
        K, at = w.length - w.settle, np.searchsorted(rows, w.samples)
        steps = (pushes[at] + pushes[at - 1]).reshape(-1, pushes.shape[1]) / 2
        mass = w.integrated(steps) * (K * w.dt) ** 2
        return Told(fit.residual, fit.flat[:, :P] * fit.scales[:P], mass, late)

    def numbers(self, carried: Carried) -> Array:
        """Of bodies on the way to the tip, more than stated (10 B,)."""
        r = self.recording
        return carried.numbers(r.robot, r.index)[self.path - 1].ravel()

    def slopes(self, carried: Carried) -> Array:
        """Derivatives of these by the values (10 B, P)."""
        r = self.recording
        slopes = carried.slopes(r.robot, r.index)[:, self.path - 1]
        return slopes.reshape(len(slopes), BODY * len(self.path)).T

    @cached_property
    def size(self) -> tuple[float, float]:
        """What the arm weighs [kg], and how far it reaches [m]."""
        return size_of(self.recording.robot.chain())

    def scales(self, carried: Carried) -> Array:
        """Widths of the priors of values (P,)."""
        arm, reach = self.size
        tip, link = CarriedMass(True, arm, reach).parameters, LinkInertia(1, reach).parameters
        return np.array([
            p.scale for body in carried.bodies
            for p in (link if body.link else tip)[: len(body.values)]
        ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class MassFit:
    """A mass as all joints have it."""

    carried: Carried
    late: float  # how much later than so far all are by it [s]
    residuals: tuple[Array, ...]  # what it leaves of each joint (W, K) [rad]
    covariance: Array  # of its values (P, P)
    occam: float  # what its evidence is less by: how well it is told, and how large it is
    late_std: float  # standard error of the lateness [s]
    off: float  # standard errors that its values moved from those of the states

    real: bool = True  # whether bodies can be so

    @property
    def squares(self) -> Array:
        """Mean squares of what it leaves of each joint (n,) [rad^2]."""
        return np.array([max(float(np.mean(r**2)), FINEST**2) for r in self.residuals])

    @property
    def times(self) -> Array:
        """Correlation times of that (n,) [samples]."""
        return np.array([correlation_time(r) for r in self.residuals])

    def score(self, times: Array) -> float:
        """Log evidence of it, samples counting as independent so far apart (n,)."""
        if not self.real:
            return -float("inf")
        counts = np.array([r.size for r in self.residuals]) / times
        return float(-counts @ np.log(self.squares) / 2 - self.occam)


def fitted_mass(telling: Telling, carried: Carried, *, clock: bool) -> MassFit:
    """The masses that all joints tell best, from some values on.

    Args:
        telling: What they tell.
        carried: Which bodies, with the values to begin at.
        clock: Whether one clock of all may be late, or lead, besides.
    """
    scales = np.append(telling.scales(carried), ActuationDelay.parameter.scale)
    least = np.array([
        p.lower if k == 0 else -np.inf for body in carried.bodies
        for k, p in enumerate(body.declared)
    ])  # fmt: skip
    x = np.append(np.array(carried.values, dtype=float), 0.0)
    for _ in range(ITERATIONS):
        more, b = _sums(telling, carried, x, clock=clock)
        A = np.diag(scales**-2.0) + more
        scaled = A * np.outer(scales, scales)
        step = -np.linalg.solve(scaled, b * scales) * scales
        if not np.isfinite(step).all():
            break
        step[:-1] = np.maximum(step[:-1], (least - x[:-1]) / 2)  # no mass is less than nothing
        x = x + step
        if step @ A @ step < ENOUGH:
            break
    C, within = np.asarray(np.linalg.inv(A), dtype=float), x[:-1] / scales[:-1]
    occam = float(np.linalg.slogdet(scaled)[1] + within @ within) / 2
    found = carried.valued(x[:-1])
    return MassFit(
        found, float(x[-1]), _left(telling, found, x[-1]), C[:-1, :-1], occam,
        float(C[-1, -1] ** 0.5), _off(telling, found, C[:-1, :-1]),
        found.is_real(telling.recording.robot, telling.recording.index),
    )  # fmt: skip


def _left(telling: Telling, carried: Carried, late: float) -> tuple[Array, ...]:
    """What masses and a lateness [s] leave of each joint (W, K) [rad]."""
    shift = telling.numbers(carried) - telling.numbers(telling.recording.carried)
    return tuple(one.left(shift, late) for one in telling.joints)


def _sums(telling: Telling, carried: Carried, x: Array, *, clock: bool) -> tuple[Array, Array]:
    """Precision (P + 1, P + 1) and pull (P + 1,) of all joints, each by what it leaves itself."""
    now = carried.valued(x[:-1])
    slopes, A, b = telling.slopes(now), np.zeros((len(x), len(x))), np.zeros(len(x))
    for one, r in zip(telling.joints, _left(telling, now, x[-1]), strict=True):
        weight = 1 / (correlation_time(r) * max(float(np.mean(r**2)), FINEST**2))
        more = one.sums(slopes, r, weight, clock=clock)
        A, b = A + more[0], b + more[1]
    return A, b


def _off(telling: Telling, carried: Carried, covariance: Array) -> float:
    """Standard errors that values are off those of the states; infinite of other bodies."""
    begun = telling.recording.carried
    if not carried.alike(begun):
        return float("inf")
    off = np.subtract(carried.values, begun.values)
    return float(np.sqrt(off @ np.linalg.solve(covariance, off)))


def path_of(r: MotionRecording) -> Integers:
    """Joints of the model (B,) on the way to the tip."""
    return np.array([j for j in r.robot.model.supports[tip_of(r.robot)[0]] if j > 0], np.int64)


def _columns(s: Signals, rows: Integers, path: Integers) -> Array:
    """Torques of every joint (R, n, 10 B) by numbers of bodies on the way to the tip."""
    r = s.recording
    model, index = model_of(r), list(r.index)
    data, neutral = model.createData(), pin.neutral(model)
    moved, v, a = np.zeros((3, len(rows), model.nv))
    moved[:, index], v[:, index] = s.posture[rows], s.turning[rows]
    a[:, index] = s.acceleration[rows]
    found = np.empty((len(rows), r.n, BODY * len(path)))
    own = (BODY * (path[:, None] - 1) + np.arange(BODY)).ravel()
    for k in range(len(rows)):
        q = pin.integrate(model, neutral, moved[k])
        Y = pin.computeJointTorqueRegressor(model, data, q, v[k], a[k])
        found[k] = Y.reshape(model.nv, -1)[index][:, own]  # of one joint it is flat
    return found

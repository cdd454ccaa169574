r"""What all joints together tell of a mass that the tip carries: least squares, and the evidence.

Where joints were and how they moved, torques beyond those of the file are linear in the mass's
numbers p (:mod:`~plumbline.optim.diagnosis.motion.carried`): :math:`Y(q, \dot q, \ddot q)\, p`. A
joint of inertia :math:`J_j` that is not told of them is missed by

.. math:: \iint \frac{Y_j\, p}{J_j}\, dt^2

so that one pass over a recording has the columns of every mass. Each joint is weighed by what it is
missed by itself: one that is wrong for a reason of its own hardly counts,

.. math:: \max_p \; -\sum_j \frac{n_j}{2} \log s_j(p)

(noise integrated out), by weights :math:`n_j / s_j` again and again. What its drive was found to do
gives way (Schur).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.kinematics.effects.link_inertia import size_of
from plumbline.kinematics.effects.payload import CarriedMass
from plumbline.kinematics.oracle import pin
from plumbline.optim.diagnosis.motion.carried import (
    Carried,
    from_tip,
    model_of,
    tip_of,
)
from plumbline.optim.diagnosis.motion.clock import mean_of_ends
from plumbline.optim.diagnosis.motion.constants import BODY, ENOUGH, ITERATIONS
from plumbline.optim.diagnosis.motion.fit import correlation_time, evaluated
from plumbline.optim.diagnosis.motion.signals import Integers, Signals
from plumbline.optim.diagnosis.motion.windows import Array, Drives, Windows
from plumbline.optim.diagnosis.prior import FINEST


@dataclass(frozen=True, eq=False)
class Told:
    """What one joint's windows tell of a mass.

    Attributes:
        residual: Predicted minus measured (W, K) [rad].
        own: Derivatives by what its drive does, in widths of the priors (W K, P) [rad].
        mass: By the mass's numbers at the tip (W K, 10).
        late: By a delay (W K,) [rad/s].
    """

    residual: Array
    own: Array
    mass: Array
    late: Array

    def left(self, shift: Array, late: float = 0.0) -> Array:
        """Its residual (W, K) [rad] with other numbers, what its drive does giving way."""
        r = self.residual.ravel() + self.mass @ shift + late * self.late
        if self.own.shape[1]:
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
        self.columns = _columns(signals)
        self.joints = tuple(
            self._told(signals.windows(j, starts), j, drives[j]) for j in range(self.recording.n)
        )

    def _told(self, w: Windows, j: int, drive: Any) -> Told:
        effects, theta = drive
        P = len(effects)
        asked, values = (*effects, ActuationDelay()), np.append(theta, 0.0)
        if any(e.name == ActuationDelay.name for e in effects):
            asked, values = effects, theta
        fit = evaluated(w, asked, values)
        late = fit.flat[:, P] if len(asked) > P else np.zeros(fit.residual.size)
        rotor = sum(v for e, v in zip(effects, theta, strict=True) if e.term == "rotor")
        K = w.length - w.settle
        pushes = -self.columns[:, j] / (w.inertia + rotor)[:, None]
        pushes[1:] = mean_of_ends(pushes)
        mass = w.integrated(pushes[w.samples].reshape(-1, BODY)) * (K * w.dt) ** 2
        return Told(fit.residual, fit.flat[:, :P] * fit.scales[:P], mass, late)

    @cached_property
    def scales(self) -> Array:
        """Widths of the priors of a mass's values (10,)."""
        arm, reach = size_of(self.recording.robot.chain())
        return np.array([p.scale for p in CarriedMass(True, arm, reach).parameters])


@dataclass(frozen=True, eq=False)
class MassFit:
    """A mass as all joints have it."""

    carried: Carried
    late: float  # how much later than so far all are by it [s]
    residuals: tuple[Array, ...]  # what it leaves of each joint (W, K) [rad]
    covariance: Array  # of its values (P, P)
    occam: float  # what its evidence is less by
    late_std: float  # standard error of the lateness [s]
    off: float  # standard errors that its values moved from those of the states

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
        counts = np.array([r.size for r in self.residuals]) / times
        return float(-counts @ np.log(self.squares) / 2 - self.occam)


def fitted_mass(telling: Telling, values: Sequence[float], *, clock: bool) -> MassFit:
    """The mass that all joints tell best, from these values on.

    Args:
        telling: What they tell.
        values: Of a mass (P,), see :class:`~plumbline.optim.diagnosis.motion.carried.Carried`.
        clock: Whether one clock of all may be late, or lead, besides.
    """
    scales = np.append(telling.scales[: len(values)], ActuationDelay.parameter.scale)
    x = np.append(np.array(values, dtype=float), 0.0)
    for _ in range(ITERATIONS):
        more, b = _sums(telling, x, clock=clock)
        A = np.diag(scales**-2.0) + more
        scaled = A * np.outer(scales, scales)
        step = -np.linalg.solve(scaled, b * scales) * scales
        if values:
            step[0] = max(step[0], -x[0] / 2)  # below nothing there is none
        x = x + step
        if step @ A @ step < ENOUGH:
            break
    C = np.asarray(np.linalg.inv(A), dtype=float)
    return MassFit(
        Carried((*x[:-1].tolist(),)), float(x[-1]), _left(telling, x), C[:-1, :-1],
        float(np.linalg.slogdet(scaled)[1] / 2), float(C[-1, -1] ** 0.5),
        _off(telling, x[:-1], C[:-1, :-1]),
    )  # fmt: skip


def _left(telling: Telling, x: Array) -> tuple[Array, ...]:
    """What values and a lateness (P + 1,) leave of each joint (W, K) [rad]."""
    shift = Carried((*x[:-1],)).numbers - telling.recording.carried.numbers
    return tuple(one.left(shift, x[-1]) for one in telling.joints)


def _sums(telling: Telling, x: Array, *, clock: bool) -> tuple[Array, Array]:
    """Precision (P + 1, P + 1) and pull (P + 1,) of all joints, each by what it leaves itself."""
    slopes = Carried((*x[:-1],)).slopes
    A, b = np.zeros((len(x), len(x))), np.zeros(len(x))
    for one, r in zip(telling.joints, _left(telling, x), strict=True):
        weight = 1 / (correlation_time(r) * max(float(np.mean(r**2)), FINEST**2))
        more = one.sums(slopes, r, weight, clock=clock)
        A, b = A + more[0], b + more[1]
    return A, b


def _off(telling: Telling, values: Array, covariance: Array) -> float:
    """Standard errors that values (P,) are off those of the states; infinite in another form."""
    begun = np.array(telling.recording.carried.values)
    if len(begun) != len(values):
        return float("inf")
    off = values - begun
    return float(np.sqrt(off @ np.linalg.solve(covariance, off)))


def _columns(s: Signals) -> Array:
    """Torques of every joint by the tip's numbers (M, n, 10)."""
    r = s.recording
    model, X = model_of(r), from_tip(r.robot)
    joint, index, data = tip_of(r.robot)[0], list(r.index), model.createData()
    neutral = pin.neutral(model)
    moved, v, a = np.zeros((3, len(s.q), model.nv))
    moved[:, index], v[:, index], a[:, index] = s.posture, s.turning, s.acceleration
    found = np.empty((len(s.q), r.n, BODY))
    own = slice(BODY * (joint - 1), BODY * joint)
    for k in range(len(s.q)):
        q = pin.integrate(model, neutral, moved[k])
        Y = pin.computeJointTorqueRegressor(model, data, q, v[k], a[k])
        found[k] = Y.reshape(model.nv, -1)[index, own] @ X  # of one joint it is flat
    return found

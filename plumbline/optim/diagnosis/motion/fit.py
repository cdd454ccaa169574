r"""One joint's fit: Levenberg and Marquardt inside the bounds of its effects, and the evidence.

.. math:: \log Z = -\tfrac{n_e}{2} \log \frac{\|r\|^2}{n}
          - \tfrac12 \log \det\Bigl(I + \frac{n_e}{\|r\|^2} S J^T J S\Bigr)

Laplace's approximation with the noise integrated out, widths S of the parameters' priors, and
:math:`n_e = n / \tau` effective samples: :math:`\tau` is the residual's integrated autocorrelation
time, so that a faster clock does not make more evidence (Geyer 1992, Statistical Science 7(4)).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.constants import STILL
from plumbline.optim.diagnosis.motion.constants import ENDED, ENOUGH, ITERATIONS
from plumbline.optim.diagnosis.motion.rollout import roll_out
from plumbline.optim.diagnosis.motion.windows import Array, Effects, Windows
from plumbline.optim.diagnosis.prior import FINEST


@dataclass(frozen=True, eq=False)
class JointFit:
    """Effects of one joint with their values."""

    effects: Effects  # what they are
    theta: Array  # their values (P,)
    residual: Array  # predicted minus measured (W, K) [rad]
    J: Array  # its derivatives (W, K, P)
    sizes: Array  # factors (P,) of the parameters' widths and bounds

    @cached_property
    def square(self) -> float:
        """Mean square [rad^2], no less than that of rounded digits."""
        r = self.residual.ravel()
        return max(float(r @ r) / len(r), FINEST**2) if len(r) else 0.0

    @property
    def flat(self) -> Array:
        """Derivatives of all samples (n, P)."""
        return self.J.reshape(self.residual.size, len(self.theta))

    @cached_property
    def sums(self) -> tuple[Array, Array]:
        """Products of the derivatives with each other (P, P) and with the residual (P,)."""
        J = self.flat
        return J.T @ J, J.T @ self.residual.ravel()

    @cached_property
    def limits(self) -> tuple[Array, Array, Array]:
        """Lower and upper bounds and prior widths of the parameters, each (P,)."""
        ps = [e.parameter for e in self.effects]
        rows = np.array([[p.lower, p.upper, p.scale] for p in ps]).reshape(len(ps), 3)
        return rows[:, 0] * self.sizes, rows[:, 1] * self.sizes, rows[:, 2] * self.sizes

    @property
    def scales(self) -> Array:
        """Widths of the parameters' priors (P,)."""
        return self.limits[2]

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters (P,) no bound holds back."""
        lower, upper, scale = self.limits
        near, g = 1e-9 * scale, self.sums[1]
        held = ((self.theta <= lower + near) & (g >= 0)) | ((self.theta >= upper - near) & (g <= 0))
        return ~held

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the parameters that rest on a bound."""
        lower, upper, scale = self.limits
        near = 1e-6 * scale
        rests = (self.theta <= lower + near) | (self.theta >= upper - near)
        return tuple(e.name for e, b in zip(self.effects, rests, strict=True) if b)

    def covariance(self, effective: float) -> Array:
        """Of the parameters (P, P), so many samples counting as independent beside the prior."""
        A, both = self._information(effective), np.outer(self.scales, self.scales)
        return np.asarray(np.linalg.inv(np.eye(len(A)) + A) * both, dtype=float)

    def _information(self, effective: float) -> Array:
        """What so many samples tell of the parameters over what their priors do (P, P)."""
        A = self.sums[0] * np.outer(self.scales, self.scales)
        return np.asarray(A * (effective / max(self.residual.size, 1) / self.square))

    def evidence(self, effective: float) -> float:
        """Log evidence."""
        A = self._information(effective)
        occam = np.linalg.slogdet(np.eye(len(A)) + A)[1] / 2
        return float(-effective / 2 * np.log(self.square) - occam)


def evaluated(
    windows: Windows, effects: Effects, theta: Array, *, slopes: bool = True, rough: bool = False
) -> JointFit:
    """The effects at given values, with derivatives, rough ones of a planned way, or without."""
    predicted, J = roll_out(windows, effects, theta, slopes=slopes, rough=rough)
    residual = windows.level(predicted - windows.measured)
    return JointFit(effects, theta, residual, windows.level(J), windows.sizes(effects))


def fitted(windows: Windows, effects: Effects, start: Array, most: int = 0) -> JointFit:
    """The least square from a start, inside the bounds; early after at most so many steps."""
    rough = bool(most)
    best = evaluated(windows, effects, start, rough=rough)
    lower, upper, scale = best.limits
    if np.any((start < lower) | (start > upper)):
        best = evaluated(windows, effects, np.clip(start, lower, upper), rough=rough)
    damping, enough = 1e-3, ENOUGH if most else ENDED
    planned = any(e.plans for e in effects)  # whose derivatives cost two roll-outs each
    for _ in range((most or ITERATIONS) if effects else 0):
        free = best.free
        A = (best.sums[0] * np.outer(scale, scale))[np.ix_(free, free)]
        g = (best.sums[1] * scale)[free]
        step = np.zeros(len(scale))
        curved = A + damping * np.diag(np.diag(A)) + 1e-12 * np.trace(A) * np.eye(len(A))
        part = np.linalg.lstsq(curved, g, rcond=None)[0]
        promise = float(part @ (2.0 * g - A @ part))
        if not (planned or most) and promise <= ENDED * best.square * best.residual.size:
            break
        step[free] = -part * scale[free]
        theta = np.clip(best.theta + step, lower, upper)
        tried = evaluated(windows, effects, theta, slopes=not planned)
        gain = 1 - tried.square / max(best.square, 1e-300)
        if gain > 0:
            best = evaluated(windows, effects, theta, rough=rough) if planned else tried
            damping = max(damping / 5, 1e-9)
        else:
            damping *= 8
        if (gain >= 0 and gain < enough) or damping > 1e6:
            break
    return best


def to_go(windows: Windows, fit: JointFit, effective: float) -> float:
    """Newton's decrement: standard errors that the free parameters would still move.

    A step that promises more than may be left counts by what it gains when it is rolled out, whole,
    half or a quarter: at corners of a way, and by differences over a wide step, none may.
    """
    J, (lower, upper, _) = fit.flat * fit.free, fit.limits
    if not J.size:
        return 0.0
    step = -np.linalg.lstsq(J, fit.residual.ravel(), rcond=1e-10)[0]
    square = max(fit.square, 1e-300)
    gain = float(np.sum((J @ step) ** 2)) / len(J) / square
    if gain * effective > STILL**2:
        tried = [np.clip(fit.theta + share * step, lower, upper) for share in (1.0, 0.5, 0.25)]
        least = min(evaluated(windows, fit.effects, theta, slopes=False).square for theta in tried)
        gain = max(1 - least / square, 0.0)
    return float(np.sqrt(gain * effective))


def correlation_time(residual: Array) -> float:
    """Integrated autocorrelation time of residuals (W, K) [samples], at least one.

    So many samples are worth one where they are summed, as by slopes that run as slowly.
    """
    return float(max(2 * _initial(residual)[0] - 1, 1.0))


def square_time(residual: Array) -> float:
    """The same of their squares [samples]: in a variance each correlation counts by its square.

    Var(s^2) = 2 sigma^4 / n times the sum of rho_k^2 over all k (Bartlett 1946, JRSS Suppl. 8:27).
    Of white noise on a slow rest, of which little is foretold, variance is nearly as well known as
    of the noise alone.
    """
    return float(max(2 * _initial(residual)[1] - 1, 1.0))


def _initial(residual: Array) -> tuple[float, float]:
    """Sums of autocorrelations, and of their squares, of residuals (W, K), from lag nothing on.

    Over pairs of autocorrelations up to where one turns negative, none counting for more than one
    before it (Geyer 1992, Statistical Science 7:473, initial monotone sequence): what is left of a
    motion that repeats itself returns late, and adds to the noise of the sum.
    """
    W, K = residual.shape
    r = residual - residual.mean()
    size = 2 * K
    power = np.abs(np.fft.rfft(r, size, axis=1)) ** 2
    rho = np.fft.irfft(power.mean(axis=0), size)[:K] / np.arange(K, 0, -1)
    if W == 0 or rho[0] <= 0:
        return 1.0, 1.0
    rho = rho[: max(K * 2 // 3, 1)] / rho[0]
    both = rho[: len(rho) // 2 * 2].reshape(-1, 2)
    ends = np.flatnonzero(both.sum(axis=1) <= 0)
    last = ends[0] if len(ends) else len(both)
    pairs = (np.minimum.accumulate(x[:last]) for x in (both.sum(axis=1), np.sum(both**2, axis=1)))
    first, second = (float(x.sum()) for x in pairs)
    return first, second

r"""How far, how fast, how near: the horizon, the confidence along it, the noise it must bear.

Two things are called confidence, and both are made precise here.

**The coefficient** :math:`\alpha(i)`, i = 0 .. p-1, scales the speed that the plan may use i steps
ahead: :math:`|u(k+i|k)| \le \alpha(i)\, v_{max}`, per state. What is left,
:math:`(1 - \alpha(i))\, v_{max}`, is kept for corrections that the plan does not know yet. The
default :math:`\max(0.5, 1 - 0.02 i)` trusts the present fully and the far future by half. If the
rate that is really carried out errs by a normal deviate of standard deviation :math:`\sigma_u(i)`,
then :math:`\alpha(i) = 1 - z\, \sigma_u(i) / v_{max}` keeps it below :math:`v_{max}` with
probability :math:`\Phi(z)` (:meth:`Confidence.of_noise`).

**The quantile** z tightens distances: the distance along a fixed normal between two points whose
errors have standard deviation :math:`\sigma_i` per axis is normal with :math:`\sqrt 2\,\sigma_i`
(:math:`\sigma_i` against an obstacle whose place is known), so

.. math:: n \cdot (a - b) \ge D + z\, \sqrt{2}\, \sigma_i, \qquad
          \sigma_i^2 = \sigma_m^2 + \min(i, f)\, \sigma_w^2, \qquad z = \Phi^{-1}(1 - \epsilon)

holds in truth with probability :math:`1 - \epsilon` for one pair at one step (the linear chance
constraint; Boyd and Vandenberghe 2004, eq. 4.25). Variance stops growing after f steps, by when
feedback has seen the error.

**Smoothness.** Without limits in the way, the cost :math:`\sum |y|^2 + e\, |\Delta y|^2 + c\,
|\Delta^2 y|^2` is a linear regulator of a double integrator: in continuous time its optimum has the
poles :math:`c\, s^4 - e\, s^2 + 1 = 0`, so a command settles with the time constant
:math:`c^{1/4}` steps, and :math:`e / \sqrt c` damps it, from 0 (overshoot of 4 %) to 2 (none). The
default time constant is :math:`\tau` = 0.106 s, less where the horizon would not see two of them,
which ends in overshoot, and the default damping 0.7. They were chosen on random tasks, the smallest
at which commands are no rougher than those of one step on barrier functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc.constants import DAMPING, MM, SEEN, SMOOTHING
from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class Confidence:
    """The coefficient along the horizon: ``max(least, first - fall * i)``.

    Attributes:
        first: At the present step, in (0, 1].
        fall: Loss a step.
        least: Never less than this, in (0, first].
    """

    first: float = 1.0
    fall: float = 0.02
    least: float = 0.5

    def __post_init__(self) -> None:
        if not (0.0 < self.least <= self.first <= 1.0 and self.fall >= 0.0):
            raise PlumblineError(
                f"confidence: found first {self.first}, least {self.least}, fall {self.fall}, "
                "expected 0 < least <= first <= 1 and fall >= 0; use the defaults"
            )

    @classmethod
    def of_noise(cls, rate_std: float, v_max: float, epsilon: float = 0.01) -> Confidence:
        """Constant: rates of such an error [m/s] stay below ``v_max`` but for a share epsilon."""
        share = 1.0 - NormalDist().inv_cdf(1.0 - epsilon) * rate_std / v_max
        return cls(share, 0.0, share)

    def along(self, p: int) -> Array:
        """The coefficient (p,) at every step of the horizon."""
        return np.maximum(self.least, self.first - self.fall * np.arange(p))


@dataclass(frozen=True)
class Noise:
    """The stated noise of the plant.

    Attributes:
        measured: 1 sigma per axis of a measured point [m].
        step: 1 sigma per axis that every step adds [m].
        epsilon: Probability that one pair at one step is nearer than it should be.
        feedback: Steps after which feedback has seen an error.
        bias: Distance by which a command may miss systematically: lag, delay, gain, deadband [m].
    """

    measured: float = 0.0
    step: float = 0.0
    epsilon: float = 1e-3
    feedback: int = 3
    bias: float = 0.0

    def __post_init__(self) -> None:
        for name in ("measured", "step", "feedback", "bias"):
            if not getattr(self, name) >= 0:
                raise PlumblineError(
                    f"{name}: found {getattr(self, name)}, expected at least 0; give its size"
                )
        if not 0.0 < self.epsilon <= 0.5:
            raise PlumblineError(
                f"epsilon: found {self.epsilon}, expected in (0, 0.5]; use the default"
            )

    def tightening(self, p: int) -> Array:
        """What is added to D (p, 2) [mm]: for two bodies, and for a body and an obstacle."""
        z = NormalDist().inv_cdf(1.0 - self.epsilon)
        ahead = np.minimum(np.arange(1, p + 1), self.feedback)
        sigma, bias = MM * np.sqrt(self.measured**2 + ahead * self.step**2), MM * self.bias
        return np.stack([z * np.sqrt(2.0) * sigma + 2 * bias, z * sigma + bias], axis=1)


@dataclass(frozen=True)
class Settings:
    r"""The control problem apart from what moves in it.

    Attributes:
        p: Steps of the horizon.
        dt: One step [s].
        safe: Least clearance d_s of any two capsules [m].
        form: ``"planes"`` (the default), or the patent's ``"scalar"``.
        confidence: The coefficient along the horizon.
        noise: What distances are tightened for.
        penalty: Cost of slack [m], beside squared distances [m^2] from the goals; above any
            multiplier, slack is zero where that can be.
        effort: Cost e of a squared step ``|x(k+1) - x(k)|^2``, beside the tracking cost of 1. None
            for :math:`0.7 \sqrt c`; see the module.
        smooth: Cost c of a squared change of a step, ``|x(k+1) - 2 x(k) + x(k-1)|^2``, the first
            against the step that was last commanded. None for
            :math:`\min(\tau / dt,\, 0.53\, p)^4`.
        hold: Cost of a squared distance by which ``held`` is not zero, beside one from the goals,
            where a solver has no equations.
    """

    p: int = 10
    dt: float = 0.02
    safe: float = 0.002
    form: str = "planes"
    confidence: Confidence = Confidence()
    noise: Noise = Noise()
    penalty: float = 100.0
    effort: float | None = None
    smooth: float | None = None
    hold: float = 1e5

    @property
    def weights(self) -> tuple[float, float]:
        """The costs of effort and of changes that are meant, defaults put in."""
        usual = min(SMOOTHING / self.dt, SEEN * self.p) ** 4
        smooth = usual if self.smooth is None else self.smooth
        effort = DAMPING * smooth**0.5 if self.effort is None else self.effort
        return effort, smooth

    @property
    def apart(self) -> Array:
        """What two bodies, and a body and an obstacle, are to keep a step ahead (2,) [mm]."""
        return MM * self.safe + self.noise.tightening(1)[0]

    def __post_init__(self) -> None:
        if self.form not in ("planes", "scalar"):
            raise PlumblineError(f"form: found {self.form!r}, expected 'planes' or 'scalar'")
        least_of = {"p": 1.0, "dt": 1e-6, "safe": 0.0, "penalty": 1e-3}
        for name in (*least_of, "effort", "smooth", "hold"):
            least, value = least_of.get(name, 0.0), getattr(self, name)
            if value is not None and not value >= least:
                raise PlumblineError(
                    f"{name}: found {getattr(self, name)}, expected at least {least}; raise it"
                )

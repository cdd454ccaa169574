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

A plant that is known: what becomes of the rates that are sent, and how to allow for it.

An axis obeys its rates u late by d, in proportion 1 + g, with a zero o, not at all within a band w,
and with a lag T:

.. math:: T \dot v = \operatorname{zone}_w((1 + g)\, u(t - d) + o) - v, \qquad \dot x = v

With the inverse of the static part, :math:`u = (\operatorname{zone}_w^{-1}(r) - o) / (1 + g)`, what
is meant, r, is what is done, later. And the place at which everything under way has come to rest,

.. math:: z = x + T v + \int_{t-d}^{t} r\, ds, \qquad z_{k+1} = z_k + dt\, r_k,

is an integrator without delay or lag, whatever d and T are (Smith 1957, Chem. Eng. Progress 53(5);
Artstein 1982, IEEE TAC 27(4)): the controller plans with z, on a goal and obstacles as they will be
d + T later, and the tip follows z that much later but for curvature, :math:`T^2 \ddot r / 2`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import Among, AtLeastOne, Count, Declared, NotNegative, Portion, Range
from plumbline.errors import PlumblineError
from plumbline.kinematics.constants import TINY
from plumbline.optim.capsule_mpc.constants import (
    BRISKEST,
    CREEP,
    DAMPING,
    LONGEST,
    MM,
    ROUGHEST,
    SEEN,
    SLOWEST,
    SMOOTHING,
    WIDEST,
)
from plumbline.optim.core.problem import Array

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis


NEAR = f"finite, within {LONGEST:g} m"


def near(places: ArrayLike) -> bool:
    """Whether they can be places in m: in mm they are beyond any room."""
    return bool((np.abs(places) <= LONGEST).all())


# Of a place [m]: in mm it is beyond any room.
Coordinate = Annotated[float, Range(-LONGEST, LONGEST, mend="state it in m, not in mm")]
Point = tuple[Coordinate, Coordinate, Coordinate]
Length = Annotated[float, Range(1e-3, LONGEST, mend="state it in m")]
Thickness = Annotated[float, Range(1e-4, WIDEST, mend="state it in m")]
Depth = Annotated[float, Range(0.0, LONGEST, "(", "state it in m")]
Near = Annotated[float, Range(0.0, WIDEST, mend="give it in m")]
Rough = Annotated[float, Range(0.0, ROUGHEST, mend="give it in m")]
Speed = Annotated[float, Range(0.0, BRISKEST[0], "(", "state it in m/s")]
Acceleration = Annotated[float, Range(0.0, BRISKEST[1], "(", "state it in m/s^2")]
Jerk = Annotated[float, Range(0.0, BRISKEST[2], "(", "state it in m/s^3")]


@dataclass(frozen=True)
class Confidence(Declared):
    """The coefficient along the horizon: ``max(least, first - fall * i)``."""

    first: Portion = 1.0  #: at the present step, in (0, 1]
    fall: NotNegative = 0.02  #: loss a step
    least: Portion = 0.5  #: never less than this, in (0, first]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.least > self.first:
            raise PlumblineError(
                f"confidence: found least {self.least}, expected at most first, {self.first}; "
                "use the defaults"
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
class Noise(Declared):
    """The stated noise of the plant."""

    measured: Rough = 0.0  #: 1 sigma per axis of a measured point [m]
    step: Rough = 0.0  #: 1 sigma per axis that every step adds [m]
    #: probability that one pair at one step is nearer than it should be
    epsilon: Annotated[float, Range(0.0, 0.5, "(")] = 1e-3
    feedback: Count = 3  #: steps after which feedback has seen an error
    #: distance by which a command may miss systematically: lag, delay, gain, deadband [m]
    bias: Near = 0.0

    def tightening(self, p: int) -> Array:
        """What is added to D (p, 2) [mm]: for two bodies, and for a body and an obstacle."""
        z = NormalDist().inv_cdf(1.0 - self.epsilon)
        ahead = np.minimum(np.arange(1, p + 1), self.feedback)
        sigma, bias = MM * np.sqrt(self.measured**2 + ahead * self.step**2), MM * self.bias
        return np.stack([z * np.sqrt(2.0) * sigma + 2 * bias, z * sigma + bias], axis=1)


@dataclass(frozen=True)
class Settings(Declared):
    """The control problem apart from what moves in it."""

    p: AtLeastOne = 10  #: steps of the horizon
    dt: Annotated[float, Range(1e-6, 1.0)] = 0.02  #: one step [s]
    safe: Near = 0.002  #: least clearance d_s of any two capsules [m]
    #: separating planes, or the patent's one number a pair
    form: Annotated[str, Among(("planes", "scalar"))] = "planes"
    confidence: Confidence = Confidence()  #: the coefficient along the horizon
    noise: Noise = Noise()  #: what distances are tightened for
    #: cost of slack [m], beside squared distances [m^2] from the goals; above any multiplier, slack
    #: is zero where that can be
    penalty: Annotated[float, Range(1e-3)] = 100.0
    #: cost e of a squared step ``|x(k+1) - x(k)|^2``, beside the tracking cost of 1. None for
    #: :math:`0.7 \sqrt c`; see the module.
    effort: NotNegative | None = None
    #: cost c of a squared change of a step, ``|x(k+1) - 2 x(k) + x(k-1)|^2``, the first against the
    #: step that was last commanded. None for :math:`\min(\tau / dt,\, 0.53\, p)^4`.
    smooth: NotNegative | None = None
    #: cost of a squared distance by which ``held`` is not zero, beside one from the goals, where a
    #: solver has no equations
    hold: NotNegative = 1e5

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


Numbers = float | Sequence[float] | Array  # one for all axes, or one each

# Which field an effect fills.
FIELDS = {
    "actuation_delay": "delay",
    "actuation_lag": "lag",
    "actuation_gain": "gain",
    "actuation_offset": "offset",
    "actuation_deadband": "band",
    "actuation_play": "play",
}


# Least and most that a field may be, as constants.py tells why, and what it is counted in; a gain
# of -1 stands still, and one of 1 doubles every rate.
RANGES = (
    ("delay", 0.0, SLOWEST, "in s"),
    ("lag", 0.0, SLOWEST, "in s"),
    ("gain", -0.99, 1.0, "as a share, not in percent"),
    ("offset", -BRISKEST[0], BRISKEST[0], "in m/s"),
    ("band", 0.0, BRISKEST[0], "in m/s"),
    ("play", 0.0, WIDEST, "in m"),
)


@dataclass(frozen=True, eq=False)
class Plant(Declared):
    """How each axis of the state (n) carries out rates; one number for all, or one each."""

    delay: Numbers = 0.0  # time until a rate acts [s]
    lag: Numbers = 0.0  # time constant [s]
    gain: Numbers = 0.0  # share by which rates are exceeded
    offset: Numbers = 0.0  # rate at which it moves when told to rest [m/s]
    band: Numbers = 0.0  # rates below this are not carried out [m/s]
    # whether rates beyond the band are less by it (1), or whole from twice the band on (0)
    less: Numbers = 0.0
    play: Numbers = 0.0  # half the play, or by how much friction stops a position loop short [m]

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, least, most, unit in RANGES:
            values = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            wrong = values[(values < least) | (values > most)]
            if len(wrong):
                raise PlumblineError(
                    f"{name}: found {wrong[0]:.4g}, expected {least:g} to {most:g}; give it {unit}"
                )

    @classmethod
    def of(cls, answer: MotionDiagnosis) -> Plant:
        """The plant that a diagnosed ``tracking`` recording shows."""
        if answer.recording.unit != "m":
            raise PlumblineError(
                f"{answer.recording.name}: a diagnosis of joints, of a tip expected; record "
                "'tracking' with the tip's axes"
            )
        found: dict[str, Any] = {n: np.zeros(answer.recording.n) for n in cls.__annotations__}
        for number, fit in answer.fits.items():
            for effect, value in zip(fit.effects, fit.theta, strict=True):
                if effect.name in FIELDS:
                    field = FIELDS[effect.name]
                    # a log's, not a plant's
                    value = max(value, 0.0) if field == "delay" else value
                    found[field][number - 1] = value
                    found["less"][number - 1] += float(getattr(effect, "less", False))
        return cls(**found)

    def rate(self, meant: Array) -> Array:
        """The rates (n,) to send so that those that are meant (n,) are carried out [m/s]."""
        size, band = np.abs(meant), np.asarray(self.band, dtype=float)
        across = np.where(np.asarray(self.less) > 0, size + band, np.maximum(size, band + size / 2))
        slow = np.minimum(1.0, size / np.maximum(CREEP * band, TINY))
        sent = np.sign(meant) * (size + slow * (across - size))
        return np.asarray((sent - np.asarray(self.offset)) / (1.0 + np.asarray(self.gain)))

    def taken_up(self, meant: Array, side: Array) -> Array:
        r"""Where in its play each axis (n,) is to be after a way that is meant (n,) [m].

        The drive goes ahead, :math:`s \to \operatorname{clip}(s + 10\, \Delta, \pm b)`: a tenth of
        the play crosses it, and less does not.
        """
        play = np.asarray(self.play, dtype=float)
        return np.clip(side + meant / CREEP, -play, play)

    def bias(self, speed: float, acceleration: float) -> float:
        r"""By how much a tip of such a speed and acceleration may stray [m]: ``Noise.bias``.

        A lag cuts corners by :math:`T^2 a / 2`, axes that are not equally late turn the way, and
        play that is crossed where there is none moves the tip by it.
        """
        late = np.asarray(self.delay) + np.asarray(self.lag)
        turned = speed * float(late.max() - late.min())
        return float(np.max(self.lag) ** 2 * acceleration / 2 + turned + np.max(self.play))


@dataclass(frozen=True)
class Safety(Declared):
    """Options of the net."""

    budget: NotNegative = 0.02  # time that a plan may take [s]; a later one is not used
    patience: Count = 5  # steps without a usable measurement, after which motion stops
    delay: Count = 0  # steps that a command is known to take until it acts
    # what else is known of what carries commands out, its delay beyond these steps; a diagnosed
    # ``tracking`` recording tells: :meth:`Plant.of`
    plant: Plant = field(default_factory=Plant)

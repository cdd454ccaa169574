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

from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import Among, AtLeastOne, Count, Declared, NotNegative, Portion, Range
from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.plant import Plant as Plant
from plumbline.optim.core.problem import Array

NEAR = f"finite, within {constants.LONGEST:g} m"


def near(places: ArrayLike) -> bool:
    """Whether they can be places in m: in mm they are beyond any room."""
    return bool((np.abs(places) <= constants.LONGEST).all())


# Of a place [m]: in mm it is beyond any room.
Coordinate = Annotated[
    float, Range(-constants.LONGEST, constants.LONGEST, mend="state it in m, not in mm")
]
Point = tuple[Coordinate, Coordinate, Coordinate]
Length = Annotated[float, Range(1e-3, constants.LONGEST, mend="state it in m")]
Thickness = Annotated[float, Range(1e-4, constants.WIDEST, mend="state it in m")]
Depth = Annotated[float, Range(0.0, constants.LONGEST, "(", "state it in m")]
Near = Annotated[float, Range(0.0, constants.WIDEST, mend="give it in m")]
Rough = Annotated[float, Range(0.0, constants.ROUGHEST, mend="give it in m")]
Speed = Annotated[float, Range(0.0, constants.BRISKEST[0], "(", "state it in m/s")]
Acceleration = Annotated[float, Range(0.0, constants.BRISKEST[1], "(", "state it in m/s^2")]
Jerk = Annotated[float, Range(0.0, constants.BRISKEST[2], "(", "state it in m/s^3")]


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
    def of_noise(cls, rate_std: float, v_max: float, epsilon: float = 0.01) -> Self:
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
        sigma, bias = (
            constants.MM * np.sqrt(self.measured**2 + ahead * self.step**2),
            constants.MM * self.bias,
        )
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
        usual = min(constants.SMOOTHING / self.dt, constants.SEEN * self.p) ** 4
        smooth = usual if self.smooth is None else self.smooth
        effort = constants.DAMPING * smooth**0.5 if self.effort is None else self.effort
        return effort, smooth

    @property
    def apart(self) -> Array:
        """What two bodies, and a body and an obstacle, are to keep a step ahead (2,) [mm]."""
        return constants.MM * self.safe + self.noise.tightening(1)[0]


@dataclass(frozen=True)
class Safety(Declared):
    """Options of the net."""

    budget: NotNegative = 0.02  # time that a plan may take [s]; a later one is not used
    patience: Count = 5  # steps without a usable measurement, after which motion stops
    delay: Count = 0  # steps that a command is known to take until it acts
    # what else is known of what carries commands out, its delay beyond these steps; a diagnosed
    # ``tracking`` recording tells: :meth:`Plant.of`
    plant: Plant = field(default_factory=Plant)

r"""A plant that is known: what becomes of the rates that are sent, and how to allow for it.

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

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc.constants import CREEP
from plumbline.optim.core.problem import Array

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis

# Which field an effect fills.
FIELDS = {
    "actuation_delay": "delay",
    "actuation_lag": "lag",
    "actuation_gain": "gain",
    "actuation_offset": "offset",
    "actuation_deadband": "band",
}


@dataclass(frozen=True, eq=False)
class Plant:
    """How each axis of the state (n) carries out rates; one number for all, or one each."""

    delay: ArrayLike = 0.0  # time until a rate acts [s]
    lag: ArrayLike = 0.0  # time constant [s]
    gain: ArrayLike = 0.0  # share by which rates are exceeded
    offset: ArrayLike = 0.0  # rate at which it moves when told to rest [m/s]
    band: ArrayLike = 0.0  # rates below this are not carried out [m/s]
    # whether rates beyond the band are less by it (1), or whole from twice the band on (0)
    less: ArrayLike = 0.0

    def __post_init__(self) -> None:
        for name, least in (("delay", 0.0), ("lag", 0.0), ("band", 0.0), ("gain", -0.99)):
            values = np.asarray(getattr(self, name), dtype=float)
            if not (np.isfinite(values).all() and (values >= least).all()):
                raise PlumblineError(
                    f"{name}: found {values.min():.4g}, expected at least {least}; use the default"
                )

    @classmethod
    def of(cls, answer: MotionDiagnosis) -> Plant:
        """The plant that a diagnosed ``tracking`` recording shows; play is not inverted."""
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
        slow = np.minimum(1.0, size / np.maximum(CREEP * band, 1e-12))
        sent = np.sign(meant) * (size + slow * (across - size))
        return np.asarray((sent - np.asarray(self.offset)) / (1.0 + np.asarray(self.gain)))

    def bias(self, speed: float, acceleration: float) -> float:
        r"""By how much a tip of such a speed and acceleration may stray [m]: ``Noise.bias``.

        A lag cuts corners by :math:`T^2 a / 2`, and axes that are not equally late turn the way.
        """
        late = np.asarray(self.delay) + np.asarray(self.lag)
        return float(np.max(self.lag) ** 2 * acceleration / 2 + speed * (late.max() - late.min()))


@dataclass(frozen=True)
class Safety:
    """Options of the net."""

    budget: float = 0.02  # time that a plan may take [s]; a later one is not used
    patience: int = 5  # steps without a usable measurement, after which motion stops
    delay: int = 0  # steps that a command is known to take until it acts
    # what else is known of what carries commands out, its delay beyond these steps; a diagnosed
    # ``tracking`` recording tells: :meth:`.plant.Plant.of`
    plant: Plant = field(default_factory=Plant)

    def __post_init__(self) -> None:
        for name in ("budget", "patience", "delay"):
            if not getattr(self, name) >= 0:
                raise PlumblineError(
                    f"{name}: found {getattr(self, name)}, expected at least 0; use the default"
                )

r"""A plant that is known: what becomes of the rates that are sent, and how to allow for it.

Of rates u that are sent, axes make what they are asked for by gains g, by what they take of each
other, A, and by zeros o, late by d. What is asked for within a dead band w does nothing, all else
is whole; with a lag T, friction takes f of it against the motion:

.. math:: m = (1 + g)\, u(t - d) + A\, u(t - d) + o, \qquad
          T \dot v = m\,[\,|m| \ge w\,] - f \operatorname{sign} v - v, \qquad \dot x = v

Sent is :math:`u = (I + \operatorname{diag} g + A)^{-1} (r + f \operatorname{sign} r - o)`, of which
r is done, later. What lies within the dead band can only be done on average: of it, nothing or the
band's edge is asked for, whichever is nearer to what is owed, and the rest is owed
(:mod:`.underway`). And the place at which everything under way has come to rest,

.. math:: z = x + T v + \int_{t-d}^{t} r\, ds, \qquad z_{k+1} = z_k + dt\, r_k,

is an integrator without delay or lag, whatever d and T are (Smith 1957, Chem. Eng. Progress 53(5);
Artstein 1982, IEEE TAC 27(4)): the controller plans with z, on a goal and obstacles as they will be
d + T later, and the tip follows z that much later but for curvature, :math:`T^2 \ddot r / 2`.
What has play, or friction that stops its position loop short by b, follows the places w that the
rates come to as :math:`T \dot x = (|w - x| - b)_+ \operatorname{sign}(w - x)`.
All of that may be so along the axes of shafts that drives turn and slide (:mod:`.shafts`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from plumbline.declared import Declared
from plumbline.errors import PlumblineError
from plumbline.kinematics.constants import TINY
from plumbline.optim.capsule_mpc.constants import BRISKEST, CREEP, SLOWEST, WIDEST
from plumbline.optim.core.problem import Array

if TYPE_CHECKING:
    from plumbline.optim.capsule_mpc.identified import Stated
    from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis

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
    ("across", -1.0, 1.0, "as a share, not in percent"),
    ("offset", -BRISKEST[0], BRISKEST[0], "in m/s"),
    ("band", 0.0, BRISKEST[0], "in m/s"),
    ("dry", 0.0, BRISKEST[0], "in m/s"),
    ("play", 0.0, WIDEST, "in m"),
)


@dataclass(frozen=True, eq=False)
class Plant(Declared):
    """How each axis of the state (n) carries out rates; one number for all, or one each."""

    delay: Numbers = 0.0  # time until a rate acts [s]
    lag: Numbers = 0.0  # time constant [s]
    gain: Numbers = 0.0  # share by which rates are exceeded
    # share of every axis' rate that every other does as well (n, n), rows move; zero for none
    across: Numbers = 0.0
    offset: Numbers = 0.0  # rate at which it moves when told to rest [m/s]
    band: Numbers = 0.0  # rates below this are not carried out, all others whole [m/s]
    dry: Numbers = 0.0  # what friction takes of every rate [m/s]
    play: Numbers = 0.0  # half the play, or by how much friction stops a position loop short [m]
    #: whether its axes are not those of the state but of shafts that it turns and slides
    turned: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, least, most, unit in RANGES:
            values = np.ravel(np.asarray(getattr(self, name), dtype=float))
            wrong = values[~((values >= least) & (values <= most))]
            if len(wrong):
                raise PlumblineError(
                    f"{name}: found {wrong[0]:.4g}, expected {least:g} to {most:g}; give it {unit}"
                )
        beside = np.sum(np.abs(self.across), axis=-1) - 1.0 - np.asarray(self.gain)
        if np.max(beside, initial=-1.0) >= 0.0:
            raise PlumblineError(
                f"across: found {np.max(beside):.4g} beyond an axis' own 1 + gain, expected less "
                "in all of its row; give shares of other axes, and the own in gain"
            )

    @classmethod
    def of(cls, answer: MotionDiagnosis, statement: Stated | None = None) -> Plant:
        """The plant that a diagnosed ``tracking`` recording shows (:mod:`.identified`).

        Args:
            answer: The diagnosis.
            statement: The ``Statement`` of what moved, if drives may turn it about its trocars;
                the log tells.
        """
        # Only this needs recordings.
        from plumbline.optim.capsule_mpc.identified import identified

        if answer.recording.unit != "m":
            raise PlumblineError(
                f"{answer.recording.name}: a diagnosis of joints, of a tip expected; record "
                "'tracking' with the tip's axes"
            )
        names = (name for name, *_ in RANGES if name != "across")
        found: dict[str, Any] = {name: np.zeros(answer.recording.n) for name in names}
        for number, fit in answer.fits.items():
            for effect, value in zip(fit.effects, fit.theta, strict=True):
                if effect.name in FIELDS:
                    field = "dry" if getattr(effect, "less", False) else FIELDS[effect.name]
                    # a log's, not a plant's
                    value = max(value, 0.0) if field == "delay" else value
                    found[field][number - 1] = value
        return identified(cls(**found), answer.recording, statement)

    def rate(self, meant: Array) -> Array:
        """The rates (n,) to send so that those that are meant (n,) are carried out [m/s]."""
        dry = np.asarray(self.dry, dtype=float)
        moves = np.clip(meant / np.maximum(CREEP * dry, TINY), -1.0, 1.0)
        asked = meant + dry * moves - np.asarray(self.offset)
        if not np.any(self.across):
            return np.asarray(asked / (1.0 + np.asarray(self.gain)))
        own = np.diag(np.broadcast_to(1.0 + np.asarray(self.gain), meant.shape))
        return np.asarray(np.linalg.solve(own + np.asarray(self.across), asked))

    def taken_up(self, meant: Array, side: Array) -> Array:
        r"""Where in its play each axis (n,) is to be after a way that is meant (n,) [m].

        The drive goes ahead, :math:`s \to \operatorname{clip}(s + 10\, \Delta, \pm b)`: a tenth of
        the play crosses it, and less does not.
        """
        play = np.asarray(self.play, dtype=float)
        return np.clip(side + meant / CREEP, -play, play)

    def bias(self, speed: float, acceleration: float) -> float:
        r"""By how much a tip of such a speed and acceleration may stray [m]: ``Noise.bias``.

        A lag cuts corners by :math:`T^2 a / 2`, axes are ahead of the middle of what is late or
        behind it, and play that is crossed where there is none moves the tip by it.
        """
        late = np.asarray(self.delay) + np.asarray(self.lag)
        turned = speed * float(late.max() - late.min())
        return float(np.max(self.lag) ** 2 * acceleration / 2 + turned / 2 + np.max(self.play))

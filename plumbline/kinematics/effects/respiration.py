r"""The target breathes: a periodic motion of what is measured, of unknown direction and frequency.

.. math:: y \leftarrow y + \sum_{k=1}^{K} a_k \sin 2\pi k f t + b_k \cos 2\pi k f t,
          \qquad a_k, b_k \in R^3,\ K \le 3

The frequency is found from the data by a scan over 0.1 to 0.5 Hz. A breath that dwells at one end
goes as :math:`\cos^{2 n} \pi f t` with n up to 3 (Seppenwoolde et al. 2002, Int. J. Radiation
Oncology 53(4), eq. 1), which is of n harmonics.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.constants import FINER
from plumbline.kinematics.effects.effect import (
    DEVICE_OBSERVATIONS,
    FIDUCIALS,
    Effect,
    Scope,
    Stage,
    State,
)
from plumbline.kinematics.parameters import Parameter

SLOWEST, FASTEST, MOST = 0.1, 0.5, 4000
ONE_PHASE, LOOKED_AT = 0.99, 1000  # mean of a breath's phasor over so many rows: all alike
TURNS = 2 * (FASTEST - SLOWEST)  # frequencies to be tried for each second of the recording

SIZE = Parameter("m", -0.05, 0.05, scale=5e-4, doc="{}")


@dataclass(frozen=True)
class Respiration(Effect):
    """A sine of the target's place at the frequency ``frequency`` [Hz], or up to three."""

    frequency: float = field(default=0.25, metadata={"unit": "Hz"})
    harmonics: int = 1

    name = "respiration"
    stage = Stage.REGISTRATION
    depends_on = "time"
    observations = (*DEVICE_OBSERVATIONS, *FIDUCIALS)
    needs = ("time",)
    scanned = "frequency"
    words = "what is measured moves periodically, as with breathing"
    reference = "Seppenwoolde et al. (2002), Int. J. Radiation Oncology 53(4), eq. 1"
    source = (
        "Keall et al. (2006), Medical Physics 33(10), sec. II: lung and liver move by 5 to 50 mm"
    )
    sx, sy, sz = SIZE.each(*(f"in phase, along the device's {c}" for c in "xyz"))
    cx, cy, cz = SIZE.each(*(f"in quadrature, along the device's {c}" for c in "xyz"))
    sx2, sy2, sz2 = SIZE.each(*(f"twice as fast, in phase, along {c}" for c in "xyz"))
    cx2, cy2, cz2 = SIZE.each(*(f"twice as fast, in quadrature, along {c}" for c in "xyz"))
    sx3, sy3, sz3 = SIZE.each(*(f"three times as fast, in phase, along {c}" for c in "xyz"))
    cx3, cy3, cz3 = SIZE.each(*(f"three times as fast, in quadrature, along {c}" for c in "xyz"))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Six numbers a harmonic."""
        return self.declared[: 6 * self.harmonics]

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Frequencies so close that the phase drifts less than a quarter turn between them."""
        if cls.out_of_reach(scope):
            return []
        count = int(TURNS * _duration(scope)) + 1
        found = np.linspace(SLOWEST, FASTEST, max(count, 2))
        return [cls(frequency=f) for f in found.tolist() if not _in_one_phase(f, scope)]

    @classmethod
    def out_of_reach(cls, scope: Scope) -> str:
        """The recording is shorter than a breath, or so long that the frequencies are too many."""
        duration = _duration(scope)
        if duration < 1.0 / SLOWEST:
            return f"lasts {duration:.3g} s, not the {1.0 / SLOWEST:.0f} s of a slow breath"
        if TURNS * duration >= MOST:
            most = MOST / TURNS
            return (
                f"lasts {duration:.0f} s, and a breath is looked for in up to {most:.0f} s: "
                "diagnose a part of the rows"
            )
        return ""

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """The same breath with more harmonics, which dwells at one end; halves of a step."""
        step = (FASTEST - SLOWEST) / max(int(TURNS * _duration(scope)), 1)
        near = [replace(self, frequency=self.frequency + k * step) for k in FINER]
        more = (2, 3) if self.harmonics == 1 else ()
        return [*near, *(replace(self, harmonics=k) for k in more)]

    def apply(self, state: State, *values: cs.SX) -> State:
        reading = state.reading
        for k in range(self.harmonics):
            phase = 2 * np.pi * (k + 1) * self.frequency * state.row["time"]
            a, b = cs.vertcat(*values[6 * k :][:3]), cs.vertcat(*values[6 * k + 3 :][:3])
            reading = reading + a * cs.sin(phase) + b * cs.cos(phase)
        return replace(state, reading=reading)


def _in_one_phase(frequency: float, scope: Scope) -> bool:
    """Whether every row was read in the same phase of such a breath: then it is a mere shift."""
    turns = frequency * np.asarray(scope.times[:LOOKED_AT])
    return bool(np.abs(np.exp(2j * np.pi * turns).mean()) > ONE_PHASE)


def _duration(scope: Scope) -> float:
    """From the first row to the last [s]."""
    start, end = scope.span["time"]
    return end - start

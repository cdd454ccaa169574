r"""Dry friction of a drive: as much torque more, whichever way it turns.

.. math:: \tau_i \leftarrow \tau_i + c\,\sigma(\dot q_i) \qquad\text{or}\qquad
          \tau_i \leftarrow \tau_i + c\, z_k, \quad
          z_k = \max(-1, \min(1, z_{k-1} + 2 (q_{i,k} - q_{i,k-1}) / w)) \qquad\text{or}\qquad
          \tau_i \leftarrow \tau_i + c \tanh(\dot q_i / v_s)

:math:`\sigma` is the sign of the velocity, softened where the velocity is not surely one or the
other: the reading of a joint that stands still does not say which way friction holds it. Teeth and
balls yield before they slip, so after a turn friction changes sides over a way w, which is tried on
a grid: a joint that creeps a little remembers which way it came. Grease lets it creep at less
than that, up to a speed :math:`v_s`, tried as a share of the largest that was recorded. In a motion
friction takes no more speed than there is; the form ``soft`` gives way below its limit, as
simulators' does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics.drive import Drive
from plumbline.kinematics.effects.drive import DriveEffect, largest_speed
from plumbline.kinematics.effects.effect import UNSAID, Effect, Scope, State
from plumbline.kinematics.effects.hysteresis import STARTS, lag_of_play
from plumbline.kinematics.effects.motion_effect import INERT, MotionEffect
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.law import Law
from plumbline.kinematics.parameters import Parameter, between

WAYS = (0.006, 0.02, 0.06)  # rad or m: gears' play and twist together, 5 to 50 times an arc minute
LONGEST = 0.1  # rad or m, of a search about them: no gear yields further
SHARES = (0.01, 0.03, 0.1)  # of the largest speed: from next to none to what is half viscous


@dataclass(frozen=True)
class CoulombFriction(DriveEffect):
    """Friction that does not depend on the speed, but where it changes sides.

    That is over ``way`` [rad or m], or over speeds of some ``creep`` [rad/s or m/s], if any.
    """

    way: float = field(default=0.0, metadata={"unit": "rad"})
    creep: float = field(default=0.0, metadata={"unit": "rad/s"})
    # lag before the first row [way]; where it is not told, as the first motion over a way leaves it
    start: float | None = field(default=None, metadata=UNSAID)

    depends_on = "velocity"
    name = "coulomb_friction"
    words = "joint {element}'s drive works against dry friction"
    reference = (
        "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), sec. 2; with a way "
        "Al-Bender, Swevers (2008), IEEE Control Systems 28(6) (pre-sliding)"
    )
    source = "by hand: some per cent of the rated torque of drives of 3 to 20 kg of payload"
    dry = Parameter("N m", 0.0, 5.0, scale=0.1, doc="dry friction")

    @property
    def variant(self) -> str:
        """Over which way, or which speeds, it changes sides, if any."""
        if self.creep:
            return f"changes sides over {self.creep:.3g} rad/s"
        return f"changes sides over {self.way:.3g} rad" if self.way else ""

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Self]:
        """Every joint; every way that is a small part of its travel, and speed of its speeds."""
        every = super().forms(scope)
        return [f for e in every for f in (e, *e._over(scope, WAYS), *e._creeping(scope))]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Over less and more of a way, or of speeds; and wound up before as it may have been."""
        if self.creep:
            most = SHARES[-1] * largest_speed(scope, self.joint)
            return [e for e in between(self, "creep", SHARES[-1] / SHARES[-2]) if e.creep <= most]
        ways = (finer.way for finer in between(self, "way", WAYS[-1] / WAYS[-2]))
        near = self._over(scope, [way for way in ways if 0.0 < way <= LONGEST])
        lags = STARTS if self.way and self.start is None else ()
        return [*near, *(replace(self, start=lag) for lag in lags)]

    def _over(self, scope: Scope, ways: Sequence[float]) -> list[Self]:
        low, high = scope.span[f"q{self.joint}"]
        return [replace(self, way=way) for way in ways if way < (high - low) / 4]

    def _creeping(self, scope: Scope) -> list[Self]:
        fastest = largest_speed(scope, self.joint)
        speeds = [float(f"{share * fastest:.2g}") for share in SHARES]
        return [replace(self, creep=speed) for speed in speeds if speed > 0.0]

    @property
    def sliding(self) -> Self:
        """The same once it has changed sides."""
        return replace(self, way=0.0, creep=0.0, start=None)

    @property
    def _column(self) -> str:
        return f"side{self.joint}_{self.way:g}_{self.start}"

    def derive(self, rows: Mapping[str, Array]) -> Mapping[str, Array]:
        """Which way friction holds (N,), from -1 to 1, where it has a way to change sides."""
        if not self.way:
            return {}
        q = rows["q"][:, self.joint - 1]
        left = np.flatnonzero(np.abs(q - q[0]) > self.way)
        first = float(np.sign(q[left[0]] - q[0])) if len(left) else 0.0
        start = -0.5 * first if self.start is None else self.start
        return {self._column: -2.0 * lag_of_play(q, self.way, start)}

    def apply(self, state: State, *values: cs.SX) -> State:
        side = state.row[self._column] if self.way else state.row["turning"][self.joint - 1]
        if self.creep:
            side = cs.tanh(state.row["velocity"][self.joint - 1] / self.creep)
        return state.add_torque(self.joint, values[0] * side)


@dataclass(frozen=True)
class CoulombFrictionOfMotion(MotionEffect, of=CoulombFriction):
    """Friction that a torque has to overcome before anything moves, and while it does."""

    soft: bool = False  # whether a joint that is held creeps

    reference = "Moreau (1988), Nonsmooth Mechanics and Applications (dry friction, step by step)"
    laws = INERT
    of_command = True
    dry = Parameter("N m", 0.0, 5.0, scale=0.1, doc="dry friction")

    @property
    def variant(self) -> str:
        """Whether it gives way."""
        return "soft: held, the joint creeps" if self.soft else ""

    @classmethod
    def candidates(cls, law: Law, *, masses: bool) -> Sequence[MotionEffect]:
        """Hard and soft."""
        return [cls(), cls(soft=True)] if law in cls.laws else []

    def apply(self, drive: Drive, value: cs.SX) -> Drive:
        return replace(drive.changed(rubbing=value), soft=self.soft)

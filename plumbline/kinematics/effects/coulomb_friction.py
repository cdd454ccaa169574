r"""Dry friction of a drive: as much torque more, whichever way it turns.

.. math:: \tau_i \leftarrow \tau_i + c\,\sigma(\dot q_i) \qquad\text{or}\qquad
          \tau_i \leftarrow \tau_i + c\, z_k, \quad
          z_k = \max(-1, \min(1, z_{k-1} + 2 (q_{i,k} - q_{i,k-1}) / w))

:math:`\sigma` is the sign of the velocity, softened where the velocity is not surely one or the
other: the reading of a joint that stands still does not say which way friction holds it. Teeth and
balls yield before they slip, so after a turn friction changes sides over a way w, which is tried on
a grid: a joint that creeps a little remembers which way it came. In a motion it takes no more
speed than there is; the form ``soft`` gives way below its limit, as simulators' does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import casadi as cs
import numpy as np

from plumbline.kinematics.drive import Drive, Law
from plumbline.kinematics.effects.drive import DriveEffect
from plumbline.kinematics.effects.effect import Effect, Scope, State
from plumbline.kinematics.effects.hysteresis import lag_of_play
from plumbline.kinematics.effects.motion_effect import INERT, MotionEffect
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.parameters import Parameter

WAYS = (0.006, 0.02, 0.06)  # rad or m: gears' play and twist together, 5 to 50 times an arc minute
LONGEST = 0.1  # rad or m, of a search about them: no gear yields further


@dataclass(frozen=True)
class CoulombFriction(DriveEffect):
    """Friction that does not depend on the speed; ``way`` [rad or m] is where it changes sides."""

    way: float = field(default=0.0, metadata={"unit": "rad"})

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
        """Over which way it changes sides, if any."""
        return f"changes sides over {self.way:.2g} rad" if self.way else ""

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Self]:
        """Every joint; every way that is a small part of its travel."""
        return [found for e in super().forms(scope) for found in (e, *e._over(scope, WAYS))]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Over less and over more of a way."""
        ways = (self.way * f for f in (0.5, 0.7, 1.4, 2.0))
        return self._over(scope, [way for way in ways if 0.0 < way <= LONGEST])

    def _over(self, scope: Scope, ways: Sequence[float]) -> list[Self]:
        low, high = scope.span[f"q{self.joint}"]
        return [replace(self, way=way) for way in ways if way < (high - low) / 4]

    @property
    def _column(self) -> str:
        return f"side{self.joint}_{self.way:g}"

    def derive(self, rows: Mapping[str, Array]) -> Mapping[str, Array]:
        """Which way friction holds (N,), from -1 to 1, where it has a way to change sides."""
        if not self.way:
            return {}
        q = rows["q"][:, self.joint - 1]
        left = np.flatnonzero(np.abs(q - q[0]) > self.way)
        first = float(np.sign(q[left[0]] - q[0])) if len(left) else 0.0
        return {self._column: -2.0 * lag_of_play(q, self.way, -0.5 * first)}

    def apply(self, state: State, *values: cs.SX) -> State:
        side = state.row[self._column] if self.way else state.row["turning"][self.joint - 1]
        return state.add_torque(self.joint, values[0] * side)


@dataclass(frozen=True)
class CoulombFrictionOfMotion(MotionEffect):
    """Friction that a torque has to overcome before anything moves, and while it does."""

    soft: bool = False  # whether a joint that is held creeps

    name = CoulombFriction.name
    depends_on = CoulombFriction.depends_on
    words = CoulombFriction.words
    reference = "Moreau (1988), Nonsmooth Mechanics and Applications (dry friction, step by step)"
    source = CoulombFriction.source
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

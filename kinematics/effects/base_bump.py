r"""Somebody bumped into the base or the device: it moved once, at one moment.

.. math:: T_{world,base} \leftarrow T_{world,base}\, \exp([t > t_b]\, \xi)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from kinematics.effects.base_drift import BaseMotion
from kinematics.effects.effect import Effect, Scope, State

MOMENTS = 16


@dataclass(frozen=True)
class BaseBump(BaseMotion):
    """A step of the base's place after the time ``moment`` [s]."""

    moment: float = field(default=0.0, metadata={"unit": "s"})

    name = "base_bump"
    words = "the base or the measuring device was bumped: it moved at one moment"
    reference = "Page (1954), Biometrika 41, sec. 1 (one change point)"
    needs = ("time",)

    @property
    def variant(self) -> str:
        """When it happened."""
        hours = self.moment > 7200.0
        when = f"{self.moment / 3600.0:.5g} h" if hours else f"{self.moment:.5g} s"
        return f"at {when}{'' if self.turning else ', shifted only'}:"

    @classmethod
    def candidates(cls, scope: Scope) -> Sequence[Effect]:
        """Moments spread evenly over the recording, shift alone or with a turn."""
        if not cls.fits(scope):
            return []
        moments = np.linspace(*scope.span["time"], MOMENTS + 2)[1:-1]
        return [cls(turning=turn, moment=float(t)) for t in moments for turn in (True, False)]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Moments between this one's neighbours on the grid, none beyond its first and last.

        A bump that only a row or two have seen is a gross error by another name.
        """
        start, end = scope.span["time"]
        step = (end - start) / (MOMENTS + 1)
        start, end = start + 0.99 * step, end - 0.99 * step
        reach = np.array([0.03, 0.08, 0.16, 0.3, 0.5, 0.75])
        near = self.moment + step * np.concatenate([-reach, reach])
        return [replace(self, moment=float(t)) for t in near if start < t < end]

    def apply(self, state: State, *values: cs.SX) -> State:
        """Move the base of all later rows."""
        return self.moved(state, state.row["time"] > self.moment, values)

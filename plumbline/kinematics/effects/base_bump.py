r"""Somebody bumped into the base or the device: it moved once, at one moment.

.. math:: T_{world,base} \leftarrow T_{world,base}\, \exp([t > t_b]\, \xi)
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.constants import HOURS
from plumbline.kinematics.effects.base_drift import BaseMotion
from plumbline.kinematics.effects.effect import Effect, Scope, State

MOST = 120  # moments that are tried
EDGE, LEAST_SHARE = 3, 1 / 17  # rows on either side of a bump, at the least, and of all rows


@dataclass(frozen=True)
class BaseBump(BaseMotion):
    """A step of the base's place after the time ``moment`` [s]."""

    moment: float = field(default=0.0, metadata={"unit": "s"})

    depends_on = "time"
    name = "base_bump"
    words = "the base or the measuring device was bumped: it moved at one moment"
    reference = "Page (1954), Biometrika 41, sec. 1 (one change point)"
    needs = ("time",)
    scanned = "moment"

    @property
    def variant(self) -> str:
        """When it happened."""
        hours = self.moment > HOURS
        when = f"{self.moment / 3600.0:.3f} h" if hours else f"{self.moment:.5g} s"
        return f"at {when}{'' if self.turning else ', shifted only'}"

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Moments between rows, evenly many rows apart; shift alone or with a turn."""
        return [cls(turning=turn, moment=t) for turn in (True, False) for t in moments(scope)]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Of many rows, moments between this one's neighbours among those that were tried."""
        return [replace(self, moment=t) for t in moments_near(scope, self.moment)]

    def apply(self, state: State, *values: cs.SX) -> State:
        return self.moved(state, state.row["time"] > self.moment, values)


def moments(scope: Scope) -> list[float]:
    """At most :data:`MOST` moments between rows, the same number of rows apart [s]."""
    gaps = _gaps(scope)
    kept = np.unique(np.linspace(0, len(gaps) - 1, min(len(gaps), MOST)).astype(int))
    return [gaps[k] for k in kept.tolist()]


def moments_near(scope: Scope, moment: float) -> list[float]:
    """Moments between one's neighbours among those that were tried, where not all were [s]."""
    gaps = _gaps(scope)
    if len(gaps) <= MOST:
        return []
    step = -(-len(gaps) // MOST)
    mine = int(np.searchsorted(gaps, moment))
    near = gaps[max(mine - step, 0) : mine + step + 1 : max(step // 6, 1)]
    return [t for t in near if t != moment]


def _gaps(scope: Scope) -> list[float]:
    """Moments between successive rows [s] but the first and last few.

    A bump that only a row or two have seen is a gross error by another name.
    """
    edge = max(EDGE, int(LEAST_SHARE * len(scope.times)))
    times = np.unique(scope.times)
    return ((times[1:] + times[:-1]) / 2)[edge - 1 : 1 - edge].tolist()

r"""Play carried along a path: the link keeps its place until the motor has crossed the play.

.. math:: p_k = \max(q_k - w/2,\ \min(q_k + w/2,\ p_{k-1})), \qquad
          q_k \leftarrow q_k + h\, (p_k - q_k) / w

The memory makes it the play operator of Brokate and Sprekels (1996), eq. 2.1.3. Its width w
shapes the loop and is tried on a grid; its height h is fitted (h = w for rigid play).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from plumbline.kinematics.effects.effect import UNSAID, Effect, JointEffect, Scope, State
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.parameters import Parameter, between

# [rad or m] tried first, a decade apart: gears have the least, cables the most; refined afterwards.
WIDTHS = (1e-4, 1e-3, 1e-2, 1e-1)
STARTS = (-0.5, -0.25, 0.0, 0.25, 0.5)  # lags before the first row that are tried [width]


@dataclass(frozen=True)
class Hysteresis(JointEffect):
    """Play whose state depends on the whole path so far; rows must be in the order of time."""

    width: float = field(default=WIDTHS[0], metadata={"unit": "rad"})
    # lag before the first row [width]; where it is not told none, or all on ``direction``'s side
    start: float | None = field(default=None, metadata=UNSAID)

    depends_on = "direction"
    name = "hysteresis"
    words = "joint {element} lags behind along its path, by play or friction that it remembers"
    reference = "Brokate and Sprekels (1996), Hysteresis and Phase Transitions, eq. 2.1.3"
    source = (
        "width: 1 to 3 arc minutes of gears; range: a lag is a lag, and wrists on cables lag by up "
        "to 0.3 rad (Hwang et al. 2020, IEEE RA-L 5(4))"
    )
    height = Parameter("rad", 0.0, 0.35, scale=5e-4, doc="full height of the loop")

    @classmethod
    def forms(cls, scope: Scope) -> Sequence[Effect]:
        """Every joint that moves, at every width that is narrower than a quarter of its travel.

        Where ``direction`` says the side, the way to the first row may yet have taken up none.
        """
        starts = (None, 0.0) if scope.has("direction") else (None,)
        return [e for j in scope.joints for s in starts for e in cls(j, start=s)._of(WIDTHS, scope)]

    def neighbours(self, scope: Scope) -> Sequence[Effect]:
        """Narrower and wider play; and by how much the way to the first row has taken it up."""
        lags = () if self.start else STARTS
        other = [replace(self, start=lag) for lag in lags if lag != self.start]
        near = [finer.width for finer in between(self, "width", WIDTHS[1] / WIDTHS[0])]
        return [*self._of(near, scope), *other]

    def _of(self, widths: Sequence[float], scope: Scope) -> Sequence[Effect]:
        low, high = scope.span[f"q{self.joint}"]
        return [replace(self, width=w) for w in widths if w < (high - low) / 4]

    @property
    def _column(self) -> str:
        return f"play{self.joint}_{self.width:g}_{self.start}"

    def derive(self, rows: Mapping[str, Array]) -> Mapping[str, Array]:
        """The normalised lag (p - q) / w of every row, between -1/2 and 1/2.

        The path begins with the way that the first row was come to, where ``direction`` says it and
        nothing else is tried.
        """
        start = self.start
        if "direction" in rows and start is None:
            start = -0.5 * float(np.sign(rows["direction"][0, self.joint - 1]))
        return {self._column: lag_of_play(rows["q"][:, self.joint - 1], self.width, start or 0.0)}

    def apply(self, state: State, *values: cs.SX) -> State:
        return state.move_joint(self.joint, values[0] * state.row[self._column])


def lag_of_play(q: Array, width: float, start: float = 0.0) -> Array:
    """Normalised lag (p - q) / w (N,) of a play of ``width`` along a path q (N,), see above.

    Args:
        q: The path, in the order of time [rad or m].
        width: Of the play [rad or m].
        start: The lag at its beginning, between -1/2 and 1/2.
    """
    # Each reading clips the place, and so do any number of them: runs of twice as many at a time.
    low, high, step = q - width / 2, q + width / 2, 1
    while step < len(q):
        earlier, last = (low[:-step], high[:-step]), (low[step:], high[step:])
        low[step:], high[step:] = [np.clip(side, *last) for side in earlier]
        step *= 2
    return np.asarray((np.clip(q[0] + start * width, low, high) - q) / width)

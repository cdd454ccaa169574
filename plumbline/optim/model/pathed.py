r"""Commands along a path, where a joint remembers the way that it came.

.. math:: r = q + a\,\lambda_w(q) \quad\Rightarrow\quad q = r - a\,\lambda_{w - a}(r)

A play of width w that moves the link by a times its lag is undone by the lag of a narrower play
along the link's own path r (Brokate and Sprekels 1996, Hysteresis and Phase Transitions, ch. 2).
So lags are told by where the links shall be: with them held every posture stands alone, and where
the links shall be is told anew by what was commanded.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.effects.hysteresis import Hysteresis
from plumbline.optim.core.problem import Array
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.constants import LAG_ROUNDS, NARROWEST, PLACED
from plumbline.optim.model.near import Context, missing, near
from plumbline.optim.model.rows import Columns


def pathed(
    arm: Arm, wanted: Array, goal: Array, context: Context, *, placed: bool
) -> tuple[Array, Array, NDArray[np.intp]]:
    """As :func:`.near` for an arm some of whose joints remember their path, to twice as much."""
    columns, plays = arm.columns(wanted, context), _plays(arm)
    q, moved = wanted, np.zeros((len(plays), len(wanted)))
    for _ in range(LAG_ROUNDS):
        before = moved
        lags = [_lag(play, size, {**columns, "q": q}, own)
                for (play, size), own in zip(plays, moved, strict=True)]  # fmt: skip
        held = {name: lag[:, None] for name, lag in lags}
        moved = np.array([size * lag for (_, size), (_, lag) in zip(plays, lags, strict=True)])
        q, miss, rest = near(arm, wanted, goal, context, placed=placed, held=held)
        if not len(rest) and np.abs(moved - before).max() <= PLACED:
            break
    miss = missing(arm, q, goal, context, placed=placed)
    return q, miss, np.flatnonzero(np.linalg.norm(miss[:, :3], axis=1) > 2 * PLACED)


def _lag(play: Hysteresis, size: float, columns: Columns, moved: Array) -> tuple[str, Array]:
    """A play's column and its lag (N,) where it and its reading together move its link so."""
    links = columns["q"].copy()
    links[:, play.joint - 1] += moved
    scale = 1.0 / max(1.0 - size / play.width, NARROWEST)
    ((name, lag),) = play.derive({**columns, "q": scale * links}).items()
    return name, lag


def _plays(arm: Arm) -> Sequence[tuple[Hysteresis, float]]:
    """The plays and how far each moves its link."""
    found, first = [], 0
    for effect in arm.effects:
        if isinstance(effect, Hysteresis):
            found.append((effect, float(arm.values[first])))
        first += len(effect.parameters)
    return found

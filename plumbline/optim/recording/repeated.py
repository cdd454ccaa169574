"""Logs that repeat their last reading while joints are under way: rows that nobody measured."""

import numpy as np

from plumbline.errors import fault
from plumbline.optim.recording.constants import EVEN, FEW, REPEATED, UNDER_WAY
from plumbline.optim.recording.origin import Array, Origin


def refuse_repeated(told: Array, read: Array, letter: str, origin: Origin) -> None:
    """Refuse readings (N, n) that stand while commands (N, n) and joints are under way.

    Raises:
        PlumblineError: Some are that of the row before.
    """
    step = np.diff(read, axis=0)
    new, asked = np.any(step != 0.0, axis=1), np.any(np.diff(told, axis=0) != 0.0, axis=1)
    rows, size = np.flatnonzero(new), np.abs(step[new])
    least = np.where(size > 0.0, size, np.inf).min(axis=0, initial=np.inf)
    low, high = np.minimum(size[:-1], size[1:]), np.maximum(size[:-1], size[1:])
    even = (
        (step[rows[:-1]] * step[rows[1:]] > 0.0) & (low >= UNDER_WAY * least) & (high < EVEN * low)
    )
    same = np.diff(np.cumsum(asked & ~new)[rows])[moves := even.any(axis=1)]
    count = same.sum() + len(same)
    if same.sum() > max(REPEATED * count, FEW):
        first = rows[:-1][moves][np.argmax(same > 0)] + 2
        found = f"{same.sum()} of {count} rows repeat all readings as joints move"
        mend = "log both at one rate, or delete the rows that bring no new reading"
        raise fault(origin.at(f"{letter}1", first), found, "a reading a row", mend)

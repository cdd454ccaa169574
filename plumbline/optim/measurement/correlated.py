r"""Rows that know of each other: noise that wanders along the clock, and readings of one posture.

Of a noise that wanders, :math:`n_k = \rho\, n_{k-1} + \sqrt{1 - \rho^2}\, u_k` (AR(1)), each row
less what its predecessor foretells is white (Cochrane and Orcutt 1949, J. Am. Stat. Assoc. 44). Of
m readings of one posture whose noises correlate by c, the mean knows what
:math:`m / (1 + (m - 1) c)` independent readings know (Kish 1965, Survey Sampling, sec. 5.4): each
counts as one over the design effect, and copies, c = 1, count together as one reading.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from plumbline.optim.core.mapped import less_foretold
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.recording.constants import LEAST_NOISE, SAME_POSTURE
from plumbline.optim.recording.recording import Recording


def follows_of(
    recording: Recording, weights: Array | None = None, rho: float | None = None
) -> Array:
    """Correlation (N,) of each row's noise with that of the row before it; empty if none wanders.

    Of successive rows it is ``rho``, the recording's own if not given, and falls with the rows
    between them. The first row of a group, and one after a row of no weight (N,), follow none.
    """
    rho = recording.wander if rho is None else rho
    if not rho:
        return np.empty(0)
    _, place = recording.path
    follows = np.zeros(len(recording))
    follows[1:] = rho ** np.maximum(np.diff(place), 1)
    if recording.group is not None:
        follows[1:][recording.group[1:] != recording.group[:-1]] = 0.0
    if weights is not None:
        follows[1:][weights[:-1] == 0.0] = 0.0
    return follows


def trust(recording: Recording, bad: Flags | None = None) -> Array:
    """Weights (N,) of the rows: none for those distrusted, less than 1 for readings alike."""
    weights = np.ones(len(recording)) if bad is None else np.where(bad, 0.0, 1.0)
    if not recording.alike:
        return weights
    posture = postures(recording)
    readings = np.bincount(posture, weights > 0.0)[posture]
    return weights / (1.0 + np.maximum(readings - 1.0, 0.0) * recording.alike)


@dataclass(frozen=True, eq=False)
class Whitening:
    """Rows weighed and told apart, as a problem's normal equations do it."""

    root: Array  # roots of the weights (N,)
    follows: Array  # correlation (N,) of each row's noise with that of the row before it; or empty

    @classmethod
    def of(cls, recording: Recording, bad: Flags) -> Self:
        """As a recording's noise is correlated; rows taken for gross (N,) follow none."""
        weights = trust(recording, bad)
        return cls(np.sqrt(np.where(bad, 1.0, weights)), follows_of(recording, weights))

    def count(self, live: Flags) -> float:
        """How many independent residuals those that there are (N, m) count as, by weight."""
        return float(self.root**2 @ live.sum(axis=1))

    @cached_property
    def _weighed(self) -> bool:
        """Whether some row counts less than others; asked for every column that there is."""
        return bool((self.root < 1.0).any())

    def __call__(self, values: Array) -> Array:
        """Of columns (k, N, m)."""
        if self._weighed:
            values = values * self.root[:, None]
        if not self.follows.size:
            return values
        by_row = np.moveaxis(values, 1, 0)
        return np.moveaxis(less_foretold(by_row, np.zeros_like(by_row[:1]), self.follows), 0, 1)


def postures(recording: Recording) -> Indices:
    """Which posture (N,) each row is a reading of, numbered in the order of their first rows.

    Readings are repeated where angles, side of approach and payload are the same.
    """
    known = [recording.q, recording.direction, recording.payload, recording.part]
    columns = [c.reshape(len(recording), -1) for c in known if c is not None]
    same = np.round(np.hstack(columns) / SAME_POSTURE).astype(np.int64)
    _, first, label = np.unique(same, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.asarray(rank[label.ravel()], dtype=np.intp)


def copied(recording: Recording) -> bool:
    """Whether postures were read again and told the same each time, as no device does.

    What they differ by [m or rad] is less than any device reads: written anew in other digits.
    """
    posture = postures(recording)
    first = np.unique(posture, return_index=True)[1]
    apart = np.abs(recording.measured - recording.measured[first][posture])
    return len(first) < len(posture) and bool(apart.max(initial=0.0) <= LEAST_NOISE)

r"""Repeatability: how far apart the rebuilt points of one mark lie, seen from several sides.

.. math:: \rho = \frac1M \sum_m \sqrt{\frac{1}{k_m - 1} \sum_i |x_{mi} - \bar x_m|^2}

the mean over M marks of the standard deviation of the points rebuilt from k poses each (Zeng et al.
2017: 10 marks, 5 poses).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.hand_eye.beam import Array, Beam
from plumbline.optim.hand_eye.readings import Integers


@dataclass(frozen=True, eq=False)
class Marks:
    """Readings that were aimed at marks, each mark from several poses."""

    R: Array  # orientations of the flange in the base frame (N, 3, 3)
    t: Array  # its positions (N, 3) [m]
    distance: Array  # ranges (N,) [m]
    mark: Integers  # which mark was aimed at (N,)

    def __post_init__(self) -> None:
        """Refuse marks that were seen only once.

        Raises:
            PlumblineError: A mark has a single reading.
        """
        labels, counts = np.unique(self.mark, return_counts=True)
        if not len(labels) or counts.min() < 2:
            which = f"mark {labels[np.argmin(counts)]} in 1 reading" if len(labels) else "no marks"
            raise PlumblineError(
                f"{which}, 2 readings or more expected; aim at it from other sides"
            )

    def rebuilt(self, beam: Beam) -> Array:
        """The points (N, 3) [m] that a beam makes of the readings."""
        return beam.points(self.R, self.t, self.distance)

    def means(self, beam: Beam) -> Array:
        """The mean rebuilt point of every mark (M, 3) [m]."""
        points, (_, index) = self.rebuilt(beam), np.unique(self.mark, return_inverse=True)
        return _means(points, index)


def repeatability(beam: Beam, marks: Marks) -> float:
    """Repeatability [m] of a beam on marks."""
    points, (_, index) = marks.rebuilt(beam), np.unique(marks.mark, return_inverse=True)
    counts = np.bincount(index)
    gaps = points - _means(points, index)[index]
    squares = np.bincount(index, weights=np.sum(gaps**2, axis=1))
    return float(np.mean(np.sqrt(squares / (counts - 1))))


def _means(points: Array, index: Integers) -> Array:
    counts = np.bincount(index)
    sums = [np.bincount(index, weights=points[:, axis]) for axis in range(3)]
    return np.asarray(np.column_stack(sums) / counts[:, None])

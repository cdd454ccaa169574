r"""How true rebuilt points are: beside each other on marks, and against another instrument.

.. math:: \rho = \frac1M \sum_m \sqrt{\frac{1}{k_m - 1} \sum_i |x_{mi} - \bar x_m|^2}, \qquad
          FRE = \sqrt{\tfrac1n \sum_i |R p_i + t - q_i|^2}, \qquad
          TRE_i = |R_{-i}\, p_i + t_{-i} - q_i|

Repeatability is the mean over M marks of the standard deviation of the points rebuilt from k poses
each (Zeng et al. 2017: 10 marks, 5 poses); FRE and TRE are by the rigid fit of all points, and of
all points but i (Fitzpatrick, West, Maurer 1998): TRE contains the left-out point's own two errors.
"""

from dataclasses import dataclass

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Array, Integers
from plumbline.optim.hand_eye.constants import LEAST_POINTS
from plumbline.optim.hand_eye.readings import Beam
from plumbline.optim.rigid import rigid_match


@dataclass(frozen=True, eq=False)
class Marks:
    """Readings that were aimed at marks, each mark from several poses."""

    R: Array  # orientations of the flange in the base frame (N, 3, 3)
    t: Array  # its positions (N, 3) [m]
    distance: Array  # ranges (N,) [m]
    mark: Integers  # which mark was aimed at (N,)

    def __post_init__(self) -> None:
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


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of rebuilt points against another instrument's."""

    fre: float  # root mean square of the fit's residuals [m]
    tre: Array  # error of each point, left out of the fit (n,) [m]
    T: Array  # the fit of all points (4, 4): from the first instrument's frame to the second's


def leave_one_out(points: Array, others: Array) -> Accuracy:
    """FRE of points (n, 3) [m], in the base and by another instrument, and TRE of each left out."""
    if points.shape != others.shape or points.ndim != 2 or len(points) < LEAST_POINTS:
        raise PlumblineError(
            f"points {points.shape} and {others.shape}, two of (n, 3) with n >= {LEAST_POINTS} "
            "expected; give the same points by both instruments, row by row"
        )
    T = rigid_match(points, others)
    rest = np.array([np.delete(np.arange(len(points)), i) for i in range(len(points))])
    without = rigid_match(points[rest], others[rest])
    gaps = np.einsum("nij,nj->ni", without[:, :3, :3], points) + without[:, :3, 3] - others
    fre = float(np.sqrt(np.mean(np.sum((moved(T, points) - others) ** 2, axis=1))))
    return Accuracy(fre, np.linalg.norm(gaps, axis=1), T)


def moved(T: Array, points: Array) -> Array:
    """Points (N, 3) [m] carried by a transform (4, 4)."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])

r"""How well markers span space: an angle for people, singular values for the error of the rotation.

.. math:: \sin\alpha = \frac{|(M_2 - M_1) \times (M_3 - M_1)|}{|M_2 - M_1|\,|M_3 - M_1|}

The angle of a triple is its smallest inner angle, 60 deg at best; that of more markers is the best
triple's. The singular values of the centred markers, over :math:`\sqrt n`, are their standard
deviations along their own axes: the second one is the lever that holds the rotation about their
line (Fitzpatrick, West, Maurer 1998, IEEE TMI 17(5), eq. 46).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.registration.constants import MANY


@dataclass(frozen=True, eq=False)
class Condition:
    """The shape of the markers that a transform rests on."""

    angle: float  # smallest inner angle of their best triple [deg]; 0 on a line, 60 at best
    sine: float  # sine of the angle at the first marker, of the first three
    spread: Array  # standard deviations along their own axes (3,), largest first [m]
    axis: Array  # unit vector (3,) of their longest axis, in the frame of the points given

    @property
    def thickness(self) -> float:
        """Standard deviation out of their common plane [m]."""
        return float(self.spread[2])


def condition_of(points: Array) -> Condition:
    """The shape of points (n, 3) [m], n >= 3."""
    centred = points - points.mean(axis=0)
    _, values, axes = np.linalg.svd(centred, full_matrices=True)
    spread = np.zeros(3)
    spread[: len(values)] = values / np.sqrt(len(points))
    some = points[well_spread(points)]
    triples = some[list(combinations(range(len(some)), 3))]
    best = float(smallest_angles(triples).max())
    return Condition(best, sine_at_first(points), spread, axes[0])


def well_spread(points: Array, count: int = MANY) -> list[int]:
    """So many points (n, 3), by index, each farthest from those before it (Gonzalez 1985)."""
    if len(points) <= count:
        return list(range(len(points)))
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    away = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return sorted(chosen)


def smallest_angles(triples: Array) -> Array:
    """Smallest inner angle (...) of triangles (..., 3, 3) [deg]; 0 if two corners coincide."""
    sides = np.roll(triples, 1, axis=-2) - np.roll(triples, 2, axis=-2)
    lengths = np.sort(np.linalg.norm(sides, axis=-1), axis=-1)
    area = np.linalg.norm(np.cross(sides[..., 0, :], sides[..., 1, :]), axis=-1)
    beside = lengths[..., 1] * lengths[..., 2]
    sine = np.divide(area, beside, out=np.zeros_like(area), where=beside > 0)
    return np.degrees(np.arcsin(np.minimum(sine, 1.0)))


def sine_at_first(points: Array) -> float:
    """Sine of the angle at the first of the first three points (n, 3); 0 on a line."""
    a, b = points[1] - points[0], points[2] - points[0]
    lengths = np.linalg.norm(a) * np.linalg.norm(b)
    return float(np.linalg.norm(np.cross(a, b)) / lengths) if lengths else 0.0

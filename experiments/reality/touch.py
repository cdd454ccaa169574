r"""Clearances of capsules by coal, which shares no code with what plans them; lengths in mm.

Coal's test of two capsules has an absolute threshold meant for numbers of some size: in metres,
capsules shorter than 2 cm are wrong by up to half a millimetre. In mm the same data agree with
long arithmetic to 1e-5 mm where shafts are nearly parallel, and to 1e-12 mm elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def placement(ends: Array) -> tuple[float, Array, Array]:
    """Length [mm], rotation (3, 3) and middle (3,) of a capsule along its own z axis."""
    way = ends[1] - ends[0]
    length = float(np.sqrt(way @ way))
    z = way / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    x = np.zeros(3)
    x[int(np.argmin(np.abs(z)))] = 1.0
    x = x - (z @ x) * z
    x /= np.sqrt(x @ x)
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    return length, np.column_stack([x, y, z]), (ends[0] + ends[1]) / 2


@dataclass(frozen=True, eq=False)
class Touch:
    """Asks coal about pairs of capsules.

    Attributes:
        pairs: Which capsules (K, 2) to compare, by their numbers.
        radii: Radii (C,) [mm] of all capsules.
    """

    pairs: NDArray[np.intp]
    radii: Array

    def clearances(self, ends: Array) -> Array:
        """Clearance of every pair (K,) [mm], negative in penetration; ends (C, 2, 3) [mm]."""
        shapes, places = [], []
        for k, radius in enumerate(self.radii):
            length, R, middle = placement(ends[k])
            shapes.append(coal.Capsule(float(radius), length))
            places.append(coal.Transform3s(R, middle))
        request, found = coal.DistanceRequest(), np.empty(len(self.pairs))
        for n, (i, j) in enumerate(self.pairs):
            result = coal.DistanceResult()
            found[n] = coal.distance(shapes[i], places[i], shapes[j], places[j], request, result)
        return found


def all_pairs(moving: int, standing: int) -> NDArray[np.intp]:
    """Every two of the moving capsules, and each of them with each of the others (K, 2)."""
    own = [(i, j) for i in range(moving) for j in range(i + 1, moving)]
    other = [(i, moving + j) for i in range(moving) for j in range(standing)]
    return np.array([*own, *other], dtype=np.intp).reshape(-1, 2)

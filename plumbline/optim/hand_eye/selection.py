r"""The selection loop on one plane (Zeng et al. 2017): drop the farthest point, refit, repeat.

Rebuild all points, find their principal plane, drop the reading whose point lies farthest from it,
solve again; the iterate of least repeatability on marks is kept. The curve of repeatability over
iterations falls while bad readings leave, then rises as good ones do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.optim.hand_eye.beam import Array
from plumbline.optim.hand_eye.principal_plane import principal_plane
from plumbline.optim.hand_eye.readings import Integers, Readings
from plumbline.optim.hand_eye.repeatability import Marks, repeatability
from plumbline.optim.hand_eye.single_plane import SinglePlane, closed_form


@dataclass(frozen=True, eq=False)
class Selection:
    """The course of the loop."""

    best: SinglePlane  # the iterate of least repeatability
    first: SinglePlane  # the closed form on all readings
    curve: Array  # repeatability (I,) [m] of every iterate, the first of all readings
    kept: int  # iteration that was kept, from 0: so many readings were dropped
    dropped: Integers  # readings in the order in which they were dropped, by their names (I - 1,)
    readings: Readings  # the readings that the kept iterate rests on


def select(readings: Readings, marks: Marks, most: int | None = None) -> Selection:
    """Run the loop on one plane until the closed form has too few data.

    Args:
        readings: Readings of one plane.
        marks: Marks to judge by.
        most: Readings dropped at most.

    Raises:
        PlumblineError: The closed form fails on all readings.
    """
    found = [closed_form(readings)]
    curve, left = [repeatability(found[0].beam, marks)], readings
    dropped: list[int] = []
    while most is None or len(dropped) < most:
        left, name = _without_farthest(left, found[-1])
        try:
            found.append(closed_form(left))
        except PlumblineError:
            break
        dropped.append(name)
        curve.append(repeatability(found[-1].beam, marks))
    kept = int(np.argmin(curve))
    rest = readings.select(~np.isin(readings.row, dropped[:kept]))
    order = np.array(dropped, dtype=np.int64)
    return Selection(found[kept], found[0], np.array(curve), kept, order, rest)


def _without_farthest(readings: Readings, found: SinglePlane) -> tuple[Readings, int]:
    points = found.beam.points(readings.R, readings.t, readings.distance)
    worst = int(np.argmax(np.abs(principal_plane(points).distances(points))))
    return readings.select(np.arange(len(readings)) != worst), int(readings.row[worst])

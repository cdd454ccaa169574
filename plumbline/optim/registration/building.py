"""A recording of fiducials from arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault
from plumbline.optim.registration.fiducials import Fiducials, Points
from plumbline.optim.registration.markers import MarkerNoise, Markers
from plumbline.optim.registration.target import point_of


def build_fiducials(
    ct: ArrayLike,
    robot: ArrayLike,
    *,
    noise: MarkerNoise | None = None,
    labels: Sequence[str] | None = None,
    targets: Mapping[str, ArrayLike] | None = None,
    name: str = "fiducials",
) -> Fiducials:
    """A recording from arrays.

    Args:
        ct: Markers in CT (n, 3) [m].
        robot: The same by the robot, in the same order (n, 3) [m].
        noise: How well they were read; estimated from what a fit leaves over if not given.
        labels: Their names (n); M1, M2, ... if not given.
        targets: What is to be found: name and place in CT (3,) [m].
        name: What the recording is called.

    Raises:
        PlumblineError: Wrong shapes, too few markers, no finite numbers, no metres, doubled labels,
            or covariances that are none.
    """
    markers = Markers.of(ct, robot, noise, labels)
    given = {} if targets is None else targets
    doubled = [label for label in given if label in markers.labels]
    if doubled:
        where = f"target {doubled[0]}"
        raise fault(where, "a marker's label", "every label once", "rename one")
    places = [point_of(place, f"target {label}") for label, place in given.items()]
    there = np.reshape(places, (-1, 3))
    return Fiducials(
        name=name,
        markers=Points(markers.labels, markers.ct, markers.robot),
        targets=Points(tuple(given), there, np.full(there.shape, np.nan)),
        noise=noise,
    )

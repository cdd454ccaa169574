"""Poses that were written another way than they are read: quaternions turned round, inverses.

A wrong reading of the poses leaves scatter of centimetres about the planes, and the right one next
to none; so each other way is tried where the scatter is suspicious, and the readings are refused if
one of them fits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.optim.hand_eye.constants import BETTER, SUSPECT
from plumbline.optim.hand_eye.readings import Readings
from plumbline.optim.hand_eye.start import robust_start


def refuse_misread(readings: Readings, sigma: float) -> None:
    """Refuse readings that fit far better with their poses read another way.

    Args:
        readings: As given.
        sigma: Their robust scatter about the planes [m].

    Raises:
        PlumblineError: Names the way that fits.
    """
    if sigma <= SUSPECT:
        return
    for words, other in OTHER_WAYS.items():
        found = robust_start(other(readings), thorough=False)[1]
        if found * BETTER < sigma:
            raise PlumblineError(
                f"the readings scatter by {sigma * 1e3:.1f} mm about their planes, but by "
                f"{found * 1e3:.2f} mm with {words}"
            )


def _scalar_last(readings: Readings) -> Readings:
    """Quaternions whose four numbers were in the order x, y, z, w."""
    numbers = Rotation.from_matrix(readings.R).as_quat(scalar_first=True)
    return replace(readings, R=Rotation.from_quat(numbers, scalar_first=False).as_matrix())


def _transposed(readings: Readings) -> Readings:
    """Orientations of the base in the flange frame, with positions in the base frame."""
    return replace(readings, R=np.swapaxes(readings.R, 1, 2))


def _inverted(readings: Readings) -> Readings:
    """Poses of the base in the flange frame."""
    R = np.swapaxes(readings.R, 1, 2)
    return replace(readings, R=R, t=-np.einsum("nij,nj->ni", R, readings.t))


OTHER_WAYS: dict[str, Callable[[Readings], Readings]] = {
    "quaternions in the order x, y, z, w: write the scalar first (qw, qx, qy, qz)": _scalar_last,
    "orientations transposed: give those of the flange in the base frame": _transposed,
    "poses inverted: give those of the flange in the base frame": _inverted,
}

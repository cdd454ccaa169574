"""Can a frame be built from these markers?

:func:`check` refuses what no method can mend: markers on one line or in one place, millimetres, a
mirrored CT, labels that went astray.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import pdist
from scipy.special import chdtrc

from plumbline.errors import fault
from plumbline.optim.core.problem import Array
from plumbline.optim.registration.condition import condition_of
from plumbline.optim.registration.constants import (
    COINCIDENT,
    DOUBTFUL,
    MILLIMETRES,
    MUCH,
    MUCH_UNSTATED,
    ON_A_LINE,
    RELATIVE_DOUBT,
)
from plumbline.optim.registration.least_squares import best_fit
from plumbline.optim.registration.markers import Markers
from plumbline.optim.registration.relabelling import Relabelling, best_relabelling, misfits


def check(markers: Markers) -> None:
    """Refuse markers that no frame can be built from.

    Raises:
        PlumblineError: The first fault found.
    """
    _same_unit(markers)
    _apart(markers)
    _not_on_a_line(markers)
    _not_another_body(markers)


def spread_of(points: Array) -> float:
    """Root mean square distance of points (n, 3) from their mean [m]."""
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


def _same_unit(markers: Markers) -> None:
    ratio = spread_of(markers.robot) / max(spread_of(markers.ct), 1e-300)
    for what, times in (("ct", 1 / ratio if ratio else np.inf), ("robot", ratio)):
        if MILLIMETRES[0] < times < MILLIMETRES[1]:
            found = f"markers {times:.4g} times as far apart as in the other frame"
            mend = "looks like mm: divide by 1000"
            raise fault(f"markers, {what}", found, "the same distances, in m", mend)


def _apart(markers: Markers) -> None:
    first, second = np.triu_indices(len(markers), 1)
    for what, points in (("ct", markers.ct), ("robot", markers.robot)):
        distances = pdist(points)
        k = int(distances.argmin())
        if distances[k] < COINCIDENT:
            names = f"markers {markers.labels[first[k]]} and {markers.labels[second[k]]}"
            found, mend = f"{distances[k]:.3g} m between them", "measure one of them again"
            raise fault(f"{names}, {what}", found, "two different places", mend)


def _not_on_a_line(markers: Markers) -> None:
    for what, points in (("ct", markers.ct), ("robot", markers.robot)):
        angle = condition_of(points).angle
        if angle < ON_A_LINE:
            found = f"markers on one line within {angle:.2g} deg"
            mend = "move one marker well off the line of the others"
            raise fault(f"markers, {what}", found, f"at least {ON_A_LINE:g} deg", mend)


def misfit(markers: Markers) -> float:
    """Root mean square misfit of Kabsch's fit [m]."""
    return float(misfits(markers.ct[None], markers.robot)[0])


def doubtful(markers: Markers) -> bool:
    """Whether the markers misfit more than noise explains."""
    if not markers.known:
        return misfit(markers) > RELATIVE_DOUBT * spread_of(markers.robot)
    return float(chdtrc(3 * len(markers) - 6, best_fit(markers)[1])) < DOUBTFUL


def _not_another_body(markers: Markers) -> None:
    """A mirror image, or other labels, must not fit much better."""
    if not doubtful(markers):
        return
    much = MUCH if markers.known else MUCH_UNSTATED
    plain = misfit(markers)
    mirrored = float(misfits(-markers.ct[None], markers.robot)[0])
    other = best_relabelling(markers.ct, markers.robot)
    if mirrored * much < plain and mirrored <= other.misfit:
        found = f"a mirror image: it fits to {mirrored * 1e3:.3g} mm, as given {plain * 1e3:.3g} mm"
        mend = (
            "turn the sign of one CT axis (LPS and RAS differ by two), or look for a moved marker"
        )
        raise fault("markers, ct", found, "a right-handed frame", mend)
    if other.misfit * much < plain:
        found = f"labels that fit to {plain * 1e3:.3g} mm, exchanged {other.misfit * 1e3:.3g} mm"
        mend = f"mend the labels: {exchange(markers, other)}"
        raise fault("markers", found, "the same labels in both", mend)


def exchange(markers: Markers, other: Relabelling) -> str:
    """Which marker of CT is which of the robot's in another order."""
    names = markers.labels
    moved = [
        f"CT's {names[c]} is the robot's {names[r]}" for r, c in enumerate(other.order) if r != c
    ]
    return ", ".join(moved)

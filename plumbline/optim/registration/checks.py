"""Can a frame be built from these markers, and what is odd about them?

:func:`check` refuses what no method can mend: markers on one line or in one place, millimetres, a
mirrored CT, labels that went astray. :func:`remarks` says what a user should know of an answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.distance import pdist
from scipy.special import chdtrc, chdtri

from plumbline.optim.core.problem import Array
from plumbline.optim.registration.condition import ON_A_LINE, condition_of
from plumbline.optim.registration.least_squares import best_fit
from plumbline.optim.registration.markers import Markers, refusal
from plumbline.optim.registration.relabelling import Relabelling, best_relabelling
from plumbline.optim.rigid import rigid_match

if TYPE_CHECKING:
    from plumbline.optim.registration.answer import Registration

COINCIDENT = 1e-6  # [m]
NEARLY_ON_A_LINE = 15.0  # [deg], smallest inner angle of the best triple
DOUBTED = 1e-3  # chance of such a misfit under the stated noise
RELATIVE_DOUBT = 0.01  # misfit over spread, where no noise was stated
MUCH, MUCH_UNSTATED = 3.0, 10.0  # times a smaller misfit, with and without a stated noise
FLAT = 0.05  # thickness over the second spread
ASIDE = 0.1  # [m] off the markers' line, where their hold on the rotation is quoted
WIDE_TURN = np.radians(5.0)  # [rad] of rotation error beyond which first order is rough


def check(markers: Markers) -> None:
    """Refuse markers that no frame can be built from.

    Raises:
        PlumblineError: The first fault found.
    """
    _same_unit(markers)
    _apart(markers)
    _not_on_a_line(markers)
    _not_another_body(markers)


def remarks(markers: Markers, answer: Registration) -> Iterator[str]:
    """What is odd but no fault, one line each."""
    yield from _nearly_on_a_line(answer)
    yield from _flat(markers, answer)
    yield from _stretched(markers)
    yield from _unsure_labels(markers)
    if answer.rotation_std > WIDE_TURN:
        yield (
            f"the rotation is known to {np.degrees(answer.rotation_std):.2g} deg (1 sigma) only: "
            "predicted errors, which are first order, are rough"
        )


def spread_of(points: Array) -> float:
    """Root mean square distance of points (n, 3) from their mean [m]."""
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


def _same_unit(markers: Markers) -> None:
    ratio = spread_of(markers.robot) / max(spread_of(markers.ct), 1e-300)
    for what, times in (("ct", 1 / ratio if ratio else np.inf), ("robot", ratio)):
        if 300.0 < times < 3000.0:
            found = f"markers {times:.4g} times as far apart as in the other frame"
            mend = "looks like mm: divide by 1000"
            raise refusal(f"markers, {what}", found, "the same distances, in m", mend)


def _apart(markers: Markers) -> None:
    first, second = np.triu_indices(len(markers), 1)
    for what, points in (("ct", markers.ct), ("robot", markers.robot)):
        distances = pdist(points)
        k = int(distances.argmin())
        if distances[k] < COINCIDENT:
            names = f"markers {markers.labels[first[k]]} and {markers.labels[second[k]]}"
            found, mend = f"{distances[k]:.3g} m between them", "measure one of them again"
            raise refusal(f"{names}, {what}", found, "two different places", mend)


def _not_on_a_line(markers: Markers) -> None:
    for what, points in (("ct", markers.ct), ("robot", markers.robot)):
        angle = condition_of(points).angle
        if angle < ON_A_LINE:
            found = f"markers on one line within {angle:.2g} deg"
            mend = "move one marker well off the line of the others"
            raise refusal(f"markers, {what}", found, f"at least {ON_A_LINE:g} deg", mend)


def misfit(markers: Markers) -> float:
    """Root mean square misfit of Kabsch's fit [m]."""
    return float(_misfits(markers.ct[None], markers.robot)[0])


def _misfits(ct: Array, robot: Array) -> Array:
    """Root mean square misfits (N,) of N versions of CT's markers (N, n, 3) [m]."""
    T = rigid_match(ct, np.broadcast_to(robot, ct.shape))
    left = ct @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3] - robot
    return np.sqrt(np.mean(np.sum(left**2, axis=2), axis=1))


def _doubtful(markers: Markers) -> bool:
    """Whether the markers misfit more than noise explains."""
    if not markers.known:
        return misfit(markers) > RELATIVE_DOUBT * spread_of(markers.robot)
    return float(chdtrc(3 * len(markers) - 6, best_fit(markers)[1])) < DOUBTED


def _not_another_body(markers: Markers) -> None:
    """A mirror image, or other labels, must not fit much better."""
    if not _doubtful(markers):
        return
    much = MUCH if markers.known else MUCH_UNSTATED
    plain = misfit(markers)
    mirrored = float(_misfits(-markers.ct[None], markers.robot)[0])
    other = best_relabelling(markers.ct, markers.robot)
    if mirrored * much < plain and mirrored <= other.misfit:
        found = f"a mirror image: it fits to {mirrored * 1e3:.3g} mm, as given {plain * 1e3:.3g} mm"
        mend = (
            "turn the sign of one CT axis (LPS and RAS differ by two), or look for a moved marker"
        )
        raise refusal("markers, ct", found, "a right-handed frame", mend)
    if other.misfit * much < plain:
        found = f"labels that fit to {plain * 1e3:.3g} mm, exchanged {other.misfit * 1e3:.3g} mm"
        mend = f"mend the labels: {_exchange(markers, other)}"
        raise refusal("markers", found, "the same labels in both", mend)


def _exchange(markers: Markers, other: Relabelling) -> str:
    names = markers.labels
    moved = [
        f"CT's {names[c]} is the robot's {names[r]}" for r, c in enumerate(other.order) if r != c
    ]
    return ", ".join(moved)


def _nearly_on_a_line(answer: Registration) -> Iterator[str]:
    shape = answer.condition
    if shape.angle >= NEARLY_ON_A_LINE:
        return
    names = ", ".join(answer.labels[k] for k in answer.used)
    line = answer.T_RC[:3, :3] @ shape.axis / answer.scale
    aside = np.linalg.svd(line[None])[2][1:] * ASIDE  # two arms square to the line
    inverse = np.linalg.inv(answer.T_RC)
    ct = (answer.centre + aside) @ inverse[:3, :3].T + inverse[:3, 3]
    worst = float(answer.tre_rms(ct).max())
    yield (
        f"markers {names} are nearly on one line ({shape.angle:.1f} deg, sine at the first "
        f"{shape.sine:.3f}): a point {ASIDE * 1e3:.0f} mm off it is found to {worst * 1e3:.2g} mm "
        "RMS; move one marker off the line"
    )


def _flat(markers: Markers, answer: Registration) -> Iterator[str]:
    shape = condition_of(markers.ct)
    if len(markers) == 3:
        yield (
            "three markers lie in one plane: a mirrored CT would go unnoticed; check one more point"
        )
    elif shape.thickness < FLAT * shape.spread[1]:
        yield (
            f"the markers lie in one plane within {shape.thickness * 1e3:.2g} mm: a mirrored CT "
            "would go unnoticed; put one marker higher"
        )


def _stretched(markers: Markers) -> Iterator[str]:
    """Distances that differ by a common factor, where the noise is known to be smaller."""
    if not (markers.known and _doubtful(markers)):
        return
    scaled = rigid_match(markers.ct, markers.robot, scale=True)
    scale = float(np.cbrt(np.linalg.det(scaled[:3, :3])))
    left = markers.ct @ scaled[:3, :3].T + scaled[:3, 3] - markers.robot
    after = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
    if after * MUCH < misfit(markers):
        yield (
            f"distances are {abs(scale - 1) * 100:.2g} % {'longer' if scale > 1 else 'shorter'} by "
            "the robot than in CT: check CT's pitch"
        )


def _unsure_labels(markers: Markers) -> Iterator[str]:
    """Labels that could be exchanged unseen, or seem to be."""
    other = best_relabelling(markers.ct, markers.robot)
    plain = misfit(markers)
    if other.misfit * MUCH < plain and _doubtful(markers):
        yield (
            f"other labels fit better ({other.misfit * 1e3:.2g} mm against {plain * 1e3:.2g} mm): "
            f"perhaps {_exchange(markers, other)}"
        )
    elif markers.known and _as_good(markers, other):
        yield (
            f"nearly symmetric markers: that {_exchange(markers, other)} would go unnoticed "
            f"({other.misfit * 1e3:.2g} mm against {plain * 1e3:.2g} mm)"
        )


def _as_good(markers: Markers, other: Relabelling) -> bool:
    """Whether exchanged labels, too, agree with the stated noise.

    Whitened squares sum up to no less than the plain ones over the largest variance.
    """
    order = list(other.order)
    largest = np.linalg.eigvalsh(markers.ct_cov + markers.robot_cov)[:, -1].max()
    least = len(markers) * other.misfit**2 / (2 * largest)
    if least > chdtri(3 * len(markers) - 6, DOUBTED):
        return False
    exchanged = replace(markers, ct=markers.ct[order], ct_cov=markers.ct_cov[order])
    return not _doubtful(exchanged)

r"""Can a frame be built from these markers, and by these labels? How well do they span space?

:func:`check` refuses what no method can mend: markers on one line or in one place, millimetres, a
mirrored CT, labels that went astray. The order of CT's markers that fits the robot's best is

.. math:: \min_{\pi \ne id} \sum_{i < j} \big(|p_{\pi i} - p_{\pi j}| - |q_i - q_j|\big)^2

Distances between markers know no frame, so that all orders are compared before any is fitted. Up to
seven markers every order is tried. Beyond that one large triple of CT's is laid on those of the
robot's that are as far apart, and the others are paired with what they come to lie nearest to (Kuhn
1955): so every turn of the markers onto themselves is found, and labels in any disorder. And, for
markers close together, every exchange of two.

The shape of markers is an angle for people, singular values for the error of the rotation: the
angle of a triple is its smallest inner angle, 60 deg at best; that of more markers is the best
triple's. The singular values of the centred markers, over :math:`\sqrt n`, are their standard
deviations along their own axes: the second one is the lever that holds the rotation about their
line (Fitzpatrick, West, Maurer 1998, IEEE TMI 17(5), eq. 46).
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, permutations

import numpy as np
import scipy
from scipy.special import chdtrc

from plumbline.errors import fault
from plumbline.optim.core.problem import Array, Indices
from plumbline.optim.registration import constants
from plumbline.optim.registration.least_squares import best_fit
from plumbline.optim.registration.markers import Markers
from plumbline.optim.rigid import rigid_match


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
    a, b = points[1] - points[0], points[2] - points[0]
    lengths = np.linalg.norm(a) * np.linalg.norm(b)
    sine = float(np.linalg.norm(np.cross(a, b)) / lengths) if lengths else 0.0
    return Condition(best, sine, spread, axes[0])


def well_spread(points: Array, count: int = constants.MANY) -> list[int]:
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


@dataclass(frozen=True)
class Relabelling:
    """An order of CT's markers, other than as given."""

    order: tuple[int, ...]  # CT's marker (from 0) that is the robot's first, second, ..
    misfit: float  # root mean square misfit of the rigid fit in that order [m]


def best_relabelling(ct: Array, robot: Array) -> Relabelling:
    """The best other order of markers (n, 3) [m]."""
    return relabellings(ct, robot)[0]


def relabellings(ct: Array, robot: Array) -> list[Relabelling]:
    """The few best other orders of markers (n, 3) [m], best first."""
    apart, wanted = _distances(ct), _distances(robot)
    if len(ct) <= constants.ALL_ORDERS:
        orders = _any_orders(apart, wanted)
    else:
        orders = np.concatenate([_turned(ct, robot, apart, wanted), _exchanges(apart, wanted)])
    left = misfits(ct[orders], robot)
    best = np.argsort(left, kind="stable")
    return [Relabelling(tuple(int(i) for i in orders[k]), float(left[k])) for k in best]


def misfits(ct: Array, robot: Array) -> Array:
    """Root mean square misfits (N,) of the rigid fits of N versions of CT's markers (N, n, 3)."""
    T = rigid_match(ct, np.broadcast_to(robot, ct.shape))
    left = ct @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3] - robot
    return np.sqrt(np.mean(np.sum(left**2, axis=2), axis=1))


def _any_orders(apart: Array, wanted: Array) -> Indices:
    """The few orders (N, n), other than the given one, with the nearest distances (n, n)."""
    orders = _orders(len(apart))
    there = apart[orders[:, :, None], orders[:, None, :]]
    cost = np.sum((there - wanted) ** 2, axis=(1, 2))
    return orders[np.argsort(cost, kind="stable")[: constants.FITTED]]


@lru_cache(maxsize=8)
def _orders(n: int) -> Indices:
    """Orders (N, n) other than the given one."""
    return np.array(list(permutations(range(n)))[1:])


def _exchanges(apart: Array, wanted: Array) -> Indices:
    r"""The few exchanges of two (N, n) with the nearest distances (n, n).

    An exchange of i and j adds :math:`2 \sum_{k \ne i, j} (D_{ik} - D_{jk})(W_{ik} - W_{jk})`.
    """
    product = apart @ wanted
    own = np.diag(product)
    cost = own[:, None] + own - product - product.T - 2.0 * apart * wanted
    i, j = np.triu_indices(len(apart), 1)
    near = np.argsort(cost[i, j], kind="stable")[: constants.FITTED]
    orders = np.tile(np.arange(len(apart)), (len(near), 1))
    rows = np.arange(len(near))
    orders[rows, i[near]], orders[rows, j[near]] = j[near], i[near]
    return orders


def _turned(ct: Array, robot: Array, apart: Array, wanted: Array) -> Indices:
    """Orders (N, n), other than the given one, with a triple of CT's on one of the robot's."""
    corners = list(combinations(well_spread(ct), 3))
    sides = ct[corners][:, 1:] - ct[corners][:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    triple = list(corners[int(areas.argmax())])
    there = _triples(apart[np.ix_(triple, triple)], wanted)
    T = rigid_match(np.broadcast_to(ct[triple], (len(there), 3, 3)), robot[there])
    placed = ct @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    off = [scipy.spatial.distance.cdist(robot, points, "sqeuclidean") for points in placed]
    nearest = np.argsort([d.min(axis=1).sum() for d in off], kind="stable")[: 2 * constants.FITTED]
    orders = {tuple(scipy.optimize.linear_sum_assignment(off[k])[1].tolist()) for k in nearest}
    orders.discard(tuple(range(len(ct))))
    return np.array(sorted(orders), dtype=np.intp).reshape(-1, len(ct))


def _triples(sides: Array, wanted: Array) -> Indices:
    """Triples (N, 3) of points at distances (n, n) that are as far apart as three others (3, 3)."""
    n, first = len(wanted), (wanted - sides[0, 1]) ** 2
    np.fill_diagonal(first, np.inf)
    pairs = np.argsort(first, axis=None, kind="stable")[: min(constants.ALIKE, n * (n - 1))]
    i, j = np.unravel_index(pairs, first.shape)
    third = first[i, j, None] + (wanted[i] - sides[0, 2]) ** 2 + (wanted[j] - sides[1, 2]) ** 2
    rows = np.arange(len(pairs))
    third[rows, i] = third[rows, j] = np.inf
    best = np.argsort(third, axis=None, kind="stable")[: min(constants.ALIKE, len(pairs) * (n - 2))]
    pair, k = np.unravel_index(best, third.shape)
    return np.column_stack([i[pair], j[pair], k])


def _distances(points: Array) -> Array:
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def check(markers: Markers) -> None:
    """Refuse markers that no frame can be built from, by the first fault found."""
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
        if constants.MILLIMETRES[0] < times < constants.MILLIMETRES[1]:
            found = f"markers {times:.4g} times as far apart as in the other frame"
            mend = "looks like mm: divide by 1000"
            raise fault(f"markers, {what}", found, "the same distances, in m", mend)


def _apart(markers: Markers) -> None:
    first, second = np.triu_indices(len(markers), 1)
    for what, points in (("ct", markers.ct), ("robot", markers.robot)):
        distances = scipy.spatial.distance.pdist(points)
        k = int(distances.argmin())
        if distances[k] < constants.COINCIDENT:
            names = f"markers {markers.labels[first[k]]} and {markers.labels[second[k]]}"
            found, mend = f"{distances[k]:.3g} m between them", "measure one of them again"
            raise fault(f"{names}, {what}", found, "two different places", mend)


def _not_on_a_line(markers: Markers) -> None:
    for what, points in (("ct", markers.ct), ("robot", markers.robot)):
        angle = condition_of(points).angle
        if angle < constants.ON_A_LINE:
            found = f"markers on one line within {angle:.2g} deg"
            mend = "move one marker well off the line of the others"
            raise fault(f"markers, {what}", found, f"at least {constants.ON_A_LINE:g} deg", mend)


def misfit(markers: Markers) -> float:
    """Root mean square misfit of Kabsch's fit [m]."""
    return float(misfits(markers.ct[None], markers.robot)[0])


def doubtful(markers: Markers) -> bool:
    """Whether the markers misfit more than noise explains."""
    if not markers.known:
        return misfit(markers) > constants.RELATIVE_DOUBT * spread_of(markers.robot)
    return float(chdtrc(3 * len(markers) - 6, best_fit(markers)[1])) < constants.DOUBTFUL


def _not_another_body(markers: Markers) -> None:
    """A mirror image, or other labels, must not fit much better."""
    if not doubtful(markers):
        return
    much = constants.MUCH if markers.known else constants.MUCH_UNSTATED
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

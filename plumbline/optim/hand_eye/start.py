r"""A start that a third of the readings may contradict, and poses written another way than read.

Beams are tried in turn: the closed form's, beams that look every way, and those of random samples
of single planes (MSAC's sampling: Torr and Zisserman 2000). From each the direct statement is
solved by Cauchy's loss; kept is the one whose residuals have the least median (LMedS: Rousseeuw
1984; of few a quantile above it: :mod:`.reweighting`), so that readings of another board or of
something behind it have no say. A start that leaves little scatter and few readings beyond it is
beyond doubt, and ends the search.

Quaternions turned round, inverses, or ranges beside the poses of other rows leave scatter of
centimetres about the planes; each other way to read the rows is tried where the scatter is
suspicious, and refused if one of them fits. Of a reading that was lost midway either most rows fit
one off, or the first half does alone.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from operator import itemgetter

import numpy as np
import scipy

from plumbline.errors import PlumblineError
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye import constants, direct
from plumbline.optim.hand_eye.readings import Beam, Frames, Readings, least_median_plane, mean_beam
from plumbline.optim.hand_eye.reweighting import robust_fit
from plumbline.optim.hand_eye.single_plane import closed_form

# Six faces and eight corners of a cube: no beam is farther than 27.4 deg from one of them.
WAYS = np.array([w for w in product((-1.0, 0.0, 1.0), repeat=3) if np.count_nonzero(w) in (1, 3)])

Start = tuple[Beam, float, Array]


def robust_start(readings: Readings, *, thorough: bool = True) -> Start:
    """The beam of least median residual, the robust scatter [m], and the residuals (N,) [m].

    Unless ``thorough``, no samples are drawn where no other start is beyond doubt.
    """
    found = _best(readings, _guesses(readings))
    if _is_sure(found) or not thorough:
        return found
    return min(found, _best(readings, _sampled(readings)), key=itemgetter(1))


def _best(readings: Readings, guesses: Iterable[Beam]) -> Start:
    """The start of least scatter from several beams, or the first that is sure."""
    found = []
    for guess in guesses:
        found.append(_fitted(readings, readings, guess))
        if _is_sure(found[-1]):
            break
    return _refined(readings, min(found, key=itemgetter(1)))


def _refined(readings: Readings, found: Start) -> Start:
    """A start whose frames follow the beam, and the better part of the points."""
    beam, sigma, errors = found
    for _ in range(constants.REFINEMENTS):
        closer = readings.select(np.abs(errors) <= constants.INNER * sigma)
        inner = closer if len(closer.planes) == len(readings.planes) else readings
        before = sigma
        beam, sigma, errors = _fitted(readings, inner, beam)
        if sigma > constants.SCATTER_SETTLED * before:
            break
    return beam, sigma, errors


def _fitted(readings: Readings, inner: Readings, beam: Beam) -> Start:
    """Cauchy's fit of all readings from a beam, in frames of the inner ones."""
    frames = Frames.of(inner, beam)
    problem = direct.state(readings, frames)
    x, errors, sigma = robust_fit(problem, direct.start(problem, beam, frames))
    return frames.beam(x), sigma, errors


def _is_sure(found: Start) -> bool:
    _, sigma, errors = found
    return sigma <= constants.SURE_SCATTER and bool(
        np.mean(np.abs(errors) > constants.BEYOND * sigma) <= constants.FEW
    )


def _guesses(readings: Readings) -> Iterator[Beam]:
    """The mean of the closed forms, where there are any, then beams that look every way."""
    found = []
    for k in readings.planes:
        try:
            found.append(closed_form(readings.on_plane(int(k))).beam)
        except PlumblineError:
            continue
    if found:
        yield mean_beam(found)
    yield from (Beam.of(np.zeros(3), way) for way in WAYS)


def _sampled(readings: Readings) -> list[Beam]:
    """Beams of random samples of single planes that leave the least median over all readings."""
    rng = np.random.default_rng(len(readings))
    planes = [readings.on_plane(int(k)) for k in readings.planes]
    found = []
    for trial in range(constants.TRIALS):
        own = planes[trial % len(planes)]
        way = Beam.of(np.zeros(3), rng.normal(size=3))
        sample = own.select(rng.choice(len(own), min(constants.SAMPLE, len(own)), replace=False))
        frames = Frames.of(sample, way)
        problem = direct.state(sample, frames)
        start = direct.start(problem, way, frames)
        beam = frames.beam(robust_fit(problem, start, constants.TRIAL_ROUNDS)[0])
        gaps = np.concatenate([_plane_gaps(beam, one) for one in planes])
        found.append((float(np.median(gaps)), beam))
    return [beam for _, beam in sorted(found, key=itemgetter(0))[: constants.KEPT]]


def _plane_gaps(beam: Beam, readings: Readings) -> Array:
    """Distances (N,) [m] of one plane's rebuilt points from their plane of least median."""
    points = beam.points(readings.R, readings.t, readings.distance)
    return np.abs(least_median_plane(points).distances(points))


def refuse_misread(readings: Readings, sigma: float) -> None:
    """Refuse readings of such a scatter [m] that fit far better otherwise read, or not at all."""
    if sigma <= constants.SUSPECT:
        return
    for words, other in OTHER_WAYS.items():
        found = robust_start(meant := other(readings), thorough=False)
        # Most readings of a half may lie on one plane whatever plane they are said to be on.
        told = len(meant) > len(readings) / 2 or _is_sure(found)
        if told and found[1] * constants.BETTER < sigma:
            raise PlumblineError(
                f"the readings scatter by {sigma * 1e3:.1f} mm about their planes, but by "
                f"{found[1] * 1e3:.2f} mm with {words}"
            )
    if sigma > constants.MOST_MISFIT:
        raise PlumblineError(
            f"the readings scatter by {sigma * 1e3:.0f} mm about their planes, at most "
            f"{constants.MOST_MISFIT * 1e3:.0f} mm expected; check the column plane, the robot and "
            "its frame"
        )


def _scalar_last(readings: Readings) -> Readings:
    """Quaternions whose four numbers were in the order x, y, z, w."""
    rotation = scipy.spatial.transform.Rotation
    numbers = rotation.from_matrix(readings.R).as_quat(scalar_first=True)
    return replace(readings, R=rotation.from_quat(numbers, scalar_first=False).as_matrix())


def _inverted(readings: Readings) -> Readings:
    """Poses of the base in the flange frame."""
    R = np.swapaxes(readings.R, 1, 2)
    return replace(readings, R=R, t=-np.einsum("nij,nj->ni", R, readings.t))


def _moved(readings: Readings, by: int) -> Readings:
    """Ranges that stand so many rows too late, or too early, where they belong."""
    rows = np.arange(max(0, -by), len(readings) - max(0, by))
    return replace(readings.select(rows), distance=readings.distance[rows + by])


def _first_half(readings: Readings) -> Readings:
    """The first half, where it tells beam and planes by itself; else all."""
    half = readings.select(np.arange(len(readings) // 2))
    unknowns = 5 + 3 * len(half.planes)
    return half if len(half) >= constants.FOR_EACH_UNKNOWN * unknowns else readings


OTHER_WAYS: dict[str, Callable[[Readings], Readings]] = {
    "quaternions in the order x, y, z, w: write the scalar first (qw, qx, qy, qz)": _scalar_last,
    "orientations transposed: give those of the flange in the base frame": lambda r: replace(
        r, R=np.swapaxes(r.R, 1, 2)
    ),
    "poses inverted: give those of the flange in the base frame": _inverted,
    "most ranges a row later: a pose was lost, or ranges run ahead": partial(_moved, by=1),
    "most ranges a row earlier: a range was lost, or ranges lag": partial(_moved, by=-1),
    "the first half alone: a range or a pose of the second was lost, or the set-up was changed": (
        _first_half
    ),
}

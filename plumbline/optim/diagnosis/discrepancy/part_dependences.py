r"""What an unknown error of a range or of a marker may depend on: incidence, range, place, time.

At the reading's own port: along the beam for a range, along the three axes for a marker. Functions
are richer than the library's own forms, so that what is listed is named as such; beside them stand
those that are as simple: a finder's zero that creeps, a board that was moved, a CT that is sheared.
"""

from collections.abc import Iterable, Iterator
from itertools import combinations

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.discrepancy.dependence import Dependence, acting, one_of
from plumbline.optim.diagnosis.discrepancy.functions import (
    cosines,
    courses,
    jumps,
    normal,
    polynomials,
    smooth,
    spots,
    steps,
)
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.prior import FORMS, REACHES, WARMTH
from plumbline.optim.measurement.nuisance import cosines_at_start, spots_at_start
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import Integers

Place = tuple[str, int | None]  # stage, and plane or marker, from 1
FINDER: Place = ("sensor", None)
MARKERS: Place = ("registration", None)


def part_dependences(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Of what was recorded that ranges or fiducials may follow."""
    if recording.kind.ranges:
        yield from _of_ranges(recording, ports)
    else:
        yield from _of_fiducials(recording, ports)


def _of_ranges(r: Recording, ports: Ports) -> Iterator[Dependence]:
    assert r.element is not None
    cosine, slopes = cosines_at_start(r)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    wide = [smooth(normal(slopes), reach) for reach in REACHES[1:]]
    slanted = [cosines(angle, FORMS), *wide]
    yield from _one("the incidence of the beam", "incidence", FINDER, ports, slanted)
    yield from _one("the range", "range", FINDER, ports, [cosines(r.measured[:, 0], FORMS)])
    places = spots_at_start(r)
    for k in range(1, len(r.elements) + 1):
        mine = r.element == k
        flat = np.column_stack([places, np.zeros(len(places))])
        local = smooth(normal(places[mine]), REACHES[1])
        forms = [_only(local, mine), *(_only(one, mine) for one in spots(flat[mine]))]
        yield from _one(f"the place on plane {k}", "place", ("sensor", k), ports, forms)
    if r.stand_in:
        posture = smooth(normal(r.q), REACHES[-1])
        yield from _one("the pose of the flange", "posture", ("link", None), ports, [posture])
    if r.motion is not None and len(np.unique(r.motion)) > 1:
        yield from _one("the motion", "motion", FINDER, ports, [_each(r.motion)])
    yield from _of_time(r, "plane", ports)


def _of_fiducials(r: Recording, ports: Ports) -> Iterator[Dependence]:
    assert r.element is not None
    place, words = normal(r.q), "the place in CT"
    forms = [smooth(place, reach) for reach in REACHES[1:]]
    forms += [polynomials(place, degree) for degree in (1, 2, 3)]
    any_way = (acting(words, "place", *MARKERS, form, ports.shift) for form in forms)
    yield from one_of(any_way, (_along(words, one) for one in _shears(place, ports)))
    each = [_each(r.element)]
    yield from _one("each marker's own place", "marker", MARKERS, ports, each)
    yield from _of_time(r, "marker", ports)


def _shears(place: Array, ports: Ports) -> Iterator[Array]:
    """One axis of CT that leans on another (1, N, 3), as of a gantry whose tilt is not stated."""
    for i, k in combinations(range(3), 2):
        yield (place[:, i, None] * ports.joint[k])[None]


def _along(words: str, moved: Array) -> Dependence:
    return acting(words, "place", *MARKERS, np.ones(moved.shape[:2]), moved)


def _of_time(r: Recording, noun: str, ports: Ports) -> Iterator[Dependence]:
    """All readings, and those of one plane or marker, as they change with the clock.

    That all of CT creeps is the base's drift, which is listed; a finder's zero has its own way.
    """
    if r.time is None or not np.ptp(r.time) > 0.0:
        return
    assert r.element is not None
    place = FINDER if r.kind.ranges else MARKERS
    functions = np.concatenate([cosines(r.time, FORMS), steps(r.time, FORMS)])
    creeps = courses(r.time) if r.kind.ranges else ()
    yield from _one("time", "time", place, ports, [functions], creeps)
    for k in range(1, len(r.elements) + 1):
        mine = r.element == k
        if np.ptp(r.time[mine]) > 0.0:
            own = _only(cosines(r.time, WARMTH)[:, mine], mine)
            plain = [*courses(r.time[mine]), *jumps(r.time[mine])[:, None]]
            words = f"the place of {noun} {k} depends on time"
            once = (_only(form, mine) for form in plain)
            yield from _one(words, "time", (place[0], k), ports, [own], once)


def _one(
    words: str,
    on: str,
    place: Place,
    ports: Ports,
    forms: Iterable[Array],
    plain: Iterable[Array] = (),
) -> Iterator[Dependence]:
    """Forms (K, N) of one dependence of the reading, and those as simple as a listed effect."""
    kinds = ((acting(words, on, *place, f, ports.shift) for f in some) for some in (forms, plain))
    yield from one_of(*kinds)


def _each(labels: Integers) -> Array:
    """One function a label (K, N): its rows, about their mean."""
    here = (np.unique(labels)[:, None] == labels).astype(float)
    return np.asarray(here - here.mean(axis=1, keepdims=True))


def _only(functions: Array, mine: Array) -> Array:
    """Functions of some rows (K, n) as functions of all (K, N), zero elsewhere."""
    whole = np.zeros((len(functions), len(mine)))
    whole[:, mine] = functions
    return whole

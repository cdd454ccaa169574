r"""What an unknown error of a range or of a marker may depend on: incidence, range, place, time.

Columns are those of :mod:`plumbline.optim.diagnosis.discrepancy.dependences`, at the reading's own
port: along the beam for a range, along the three axes for a marker. Functions are richer than the
library's own forms, so that what is listed is named as such.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.discrepancy.functions import (
    cosines,
    normal,
    polynomials,
    random_features,
    spots,
    steps,
)
from plumbline.optim.diagnosis.prior import COSINES, MOST_MOTIONS, REACHES, STEPS, WARMTH
from plumbline.optim.measurement.nuisance import cosines_at_start, spots_at_start
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import Integers


@dataclass(frozen=True, eq=False)
class Offered:
    """What a part's reading may follow."""

    words: str  # on what it depends, as the verdict says it
    on: str  # the same in a word
    stage: str  # where it would sit
    element: int | None  # plane or marker, from 1, or None
    forms: Sequence[Array]  # functions (K, N), of which one holds


def part_functions(recording: Recording, rng: np.random.Generator) -> Iterator[Offered]:
    """Functions of what was recorded that ranges or fiducials may follow."""
    if recording.kind.ranges:
        yield from _of_ranges(recording, rng)
    else:
        yield from _of_fiducials(recording, rng)


def _of_ranges(r: Recording, rng: np.random.Generator) -> Iterator[Offered]:
    assert r.element is not None
    cosine, slopes = cosines_at_start(r)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    wide = [random_features(normal(slopes), reach, rng) for reach in REACHES[1:]]
    words = "the incidence of the beam"
    yield Offered(words, "incidence", "sensor", None, [cosines(angle, COSINES), *wide])
    yield Offered("the range", "range", "sensor", None, [cosines(r.measured[:, 0], COSINES)])
    places = spots_at_start(r)
    for k in range(1, len(r.elements) + 1):
        mine = r.element == k
        flat = np.column_stack([places, np.zeros(len(places))])
        local = random_features(normal(places[mine]), REACHES[1], rng)
        forms = [_only(local, mine), *(_only(one, mine) for one in spots(flat[mine]))]
        yield Offered(f"the place on plane {k}", "place", "sensor", k, forms)
    if r.stand_in:
        posture = random_features(normal(r.q), REACHES[-1], rng)
        yield Offered("the pose of the flange", "posture", "link", None, [posture])
    if r.motion is not None and 1 < len(np.unique(r.motion)) <= MOST_MOTIONS:
        yield Offered("the motion", "motion", "sensor", None, [_each(r.motion)])
    yield from _of_time(r, "plane", "sensor")


def _of_fiducials(r: Recording, rng: np.random.Generator) -> Iterator[Offered]:
    assert r.element is not None
    place = normal(r.q)
    forms = [random_features(place, reach, rng) for reach in REACHES[1:]]
    forms += [polynomials(place, degree) for degree in (2, 3)]
    yield Offered("the place in CT", "place", "registration", None, forms)
    yield Offered("each marker's own place", "marker", "registration", None, [_each(r.element)])
    yield from _of_time(r, "marker", "registration")


def _of_time(r: Recording, noun: str, stage: str) -> Iterator[Offered]:
    """All readings, and those of one plane or marker, as they change with the clock."""
    if r.time is None or not np.ptp(r.time) > 0.0:
        return
    assert r.element is not None
    functions = np.concatenate([cosines(r.time, COSINES), steps(r.time, STEPS)])
    yield Offered("time", "time", stage, None, [functions])
    for k in range(1, len(r.elements) + 1):
        mine = r.element == k
        if np.ptp(r.time[mine]) > 0.0:
            own = np.where(mine, cosines(r.time, WARMTH), 0.0)
            yield Offered(f"the place of {noun} {k} depends on time", "time", stage, k, [own])


def _each(labels: Integers) -> Array:
    """One function a label (K, N): its rows, about their mean."""
    here = (np.unique(labels)[:, None] == labels).astype(float)
    return np.asarray(here - here.mean(axis=1, keepdims=True))


def _only(functions: Array, mine: Array) -> Array:
    """Functions of some rows (K, n) as functions of all (K, N), zero elsewhere."""
    whole = np.zeros((len(functions), len(mine)))
    whole[:, mine] = functions
    return whole

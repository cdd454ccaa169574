r"""What an unknown torque of a drive may depend on: its own motion and load, others', the clock.

Columns are those of :mod:`plumbline.optim.diagnosis.discrepancy.dependences`, with one port a
joint: the torque of its drive, in units of its noise.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import UNMOVED
from plumbline.optim.diagnosis.discrepancy import functions
from plumbline.optim.diagnosis.prior import FORMS, MANY_ROWS, REACHES, TURNS, WARMTH
from plumbline.optim.recording.constants import GAP_IN_TIME
from plumbline.optim.recording.efforts import nominal_efforts
from plumbline.optim.recording.recording import Recording

NEIGHBOURS = np.array([-1, 0, 1])  # rows about one, for slopes in time
Offered = tuple[str, str, int, list[Array]]  # words, on what, joint from 0, forms (K, N) of it


def torque_functions(recording: Recording) -> Iterator[Offered]:
    """Functions of what was recorded that the torque of a joint may follow."""
    load, change = nominal_efforts(recording), _changes(recording)
    for j in range(recording.chain.n):
        own = _of_own(recording, load[:, j], change[:, j], j)
        for on, words, forms in (*own, *_of_others(recording, load, j)):
            live = [f for f in forms if len(f) and np.ptp(f, axis=1).max() > UNMOVED]
            if live:
                yield f"joint {j + 1}'s torque depends on {words}", on, j, live


def _of_own(
    recording: Recording, load: Array, change: Array, j: int
) -> Iterator[tuple[str, str, list[Array]]]:
    """What the joint itself does, what it carries, and when."""
    assert recording.acceleration is not None
    q = functions.as_angles(recording)[:, j]
    path, place = _thinned_path(recording)
    around = [
        functions.turns(q, TURNS, constant=False),
        *(functions.nearness(q, reach) for reach in REACHES),
    ]
    yield "own angle", "its angle", around
    yield "velocity", "its speed", [_of_speed(recording, j)]
    yield "acceleration", "its acceleration", [functions.cosines(recording.acceleration[:, j], 4)]
    yield "load", "its load", [functions.cosines(load, 4)]
    yield "direction", "the way it came", [functions.plays(path[:, j])[:, place]]
    yield "latency", "how its load changes", [change[None]]
    if recording.time is not None:
        slow = [functions.cosines(recording.time, FORMS), functions.steps(recording.time, FORMS)]
        yield "time", "time", [np.concatenate(slow)]
    if recording.temperature is not None:
        yield "temperature", "temperature", [functions.cosines(recording.temperature, WARMTH)]


def _of_others(recording: Recording, load: Array, j: int) -> Iterator[tuple[str, str, list[Array]]]:
    """What any other joint does or carries, as cross-talk of currents or coupled gears have it."""
    assert recording.velocity is not None
    assert recording.acceleration is not None
    assert recording.turning is not None
    others = [k for k in range(recording.chain.n) if k != j]
    if not others:
        return
    angles = functions.normal(recording.q[:, others]).T
    yield "posture", "the other joints' angles", [np.concatenate([np.sin(angles), np.cos(angles)])]
    turning, speed = (_sized(x) for x in (recording.turning, recording.velocity))
    moved = [np.stack([turning[k], speed[k]]) for k in others]
    carried, pushed = (_sized(x)[others, None] for x in (load, recording.acceleration))
    yield "another joint's load", "another joint's load", list(carried)
    yield "another joint's speed", "another joint's speed", moved
    yield "another joint's acceleration", "another joint's acceleration", list(pushed)


def _sized(values: Array) -> Array:
    """Columns (N, n) as rows (n, N) of mean square one; their means are part of them."""
    return np.asarray((values / np.maximum(np.sqrt(np.mean(values**2, axis=0)), 1e-12)).T)


def seen_by_drives(recording: Recording, joint: int) -> Iterator[tuple[str, Array]]:
    """Functions (K, N) that may bend a listed effect on a drive, named: of angle, load, speed."""
    assert recording.velocity is not None
    j = joint - 1
    speed = np.abs(recording.velocity[:, j])
    yield "own angle", functions.turns(functions.as_angles(recording)[:, j], 2, constant=False)
    yield "load", functions.polynomials(functions.normal(nominal_efforts(recording)[:, [j]]), 2)
    yield "velocity", functions.polynomials(functions.normal(speed[:, None]), 2)


def _changes(recording: Recording) -> Array:
    """Slopes in time of the loads (N, n), of mean square one: what a late reading adds.

    Noise of derived accelerations is in a load, and in its bend by as much: only the slope is free
    of it.
    """
    whole, place = recording.path
    found = np.zeros(recording.q.shape)
    if whole.time is None or len(whole) < len(NEIGHBOURS):
        return found
    near = np.clip(place[:, None] + NEIGHBOURS, 0, len(whole) - 1)
    gaps = np.diff(whole.time[near], axis=1)
    usual = float(np.median(np.diff(whole.time)))
    even = ((gaps > 0.0) & (gaps < GAP_IN_TIME * usual)).all(axis=1)
    loads = _loads_at(whole, near[even])
    found[even] = loads[:, -1] - loads[:, 0]
    return np.asarray(found / np.maximum(found.std(axis=0), 1e-12))


def _loads_at(whole: Recording, near: NDArray[np.intp]) -> Array:
    """Efforts (N, k, n) that the model asks for at some rows (N, k) of a path."""
    return nominal_efforts(whole.select(near.ravel())).reshape(*near.shape, whole.chain.n)


def _thinned_path(recording: Recording) -> tuple[Array, NDArray[np.intp]]:
    """The joints' way (K, n) through these rows, and the rows' places in it (N,).

    Every row and, of what lies between, as much as keeps each turning point of a smooth motion.
    """
    whole, place = recording.path
    kept = np.linspace(0, len(whole) - 1, min(len(whole), MANY_ROWS)).astype(np.intp)
    near = np.union1d(kept, place)
    return whole.q[near], np.searchsorted(near, place)


def _of_speed(recording: Recording, j: int) -> Array:
    """Bends of friction over the speed (K, N): what goes with the motion, and what does not."""
    assert recording.velocity is not None
    assert recording.turning is not None
    v, sense = recording.velocity[:, j], recording.turning[:, j]
    u = np.abs(v) / max(float(np.abs(v).max()), 1e-12)
    with_motion = [sense * np.cos(np.pi * k * u) / (1 + (k / 3) ** 2) for k in range(1, FORMS)]
    return np.stack([*with_motion, u, u**2])

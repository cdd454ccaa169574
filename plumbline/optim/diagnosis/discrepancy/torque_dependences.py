r"""What an unknown torque of a drive may depend on: angle, speed, load, command of others, time.

Columns are those of :mod:`plumbline.optim.diagnosis.discrepancy.dependences`, with one port a
joint: the torque of its drive, in units of its noise.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.discrepancy.functions import cosines, normal, plays, steps, turns
from plumbline.optim.diagnosis.prior import COSINES, PATH_ROWS, STEPS, TURNS
from plumbline.optim.recording.efforts import nominal_efforts
from plumbline.optim.recording.recording import Recording

Offered = tuple[str, str, int, Array]  # words, on what, joint from 0, functions (K, N)


def torque_functions(recording: Recording) -> Iterator[Offered]:
    """Functions of what was recorded that the torque of a joint may follow."""
    q, load = recording.q, nominal_efforts(recording)
    path, place = _thinned_path(recording)
    for j in range(recording.chain.n):
        name = f"joint {j + 1}'s torque depends on"
        yield f"{name} its angle", "own angle", j, turns(q[:, j], TURNS, constant=False)
        yield f"{name} its speed", "velocity", j, _of_speed(recording, j)
        if np.ptp(load[:, j]) > 0.0:
            yield f"{name} its load", "load", j, cosines(load[:, j], 4)
        yield f"{name} the way it came", "direction", j, plays(path[:, j])[:, place]
        if recording.time is not None and np.ptp(recording.time) > 0.0:
            slow = np.concatenate([cosines(recording.time, COSINES), steps(recording.time, STEPS)])
            yield f"{name} time", "time", j, slow
        others = np.delete(normal(q), j, axis=1)
        if others.size:
            waves = np.concatenate([np.sin(others.T), np.cos(others.T)])
            yield f"{name} the other joints' angles", "posture", j, waves


def _thinned_path(recording: Recording) -> tuple[Array, NDArray[np.intp]]:
    """The joints' way (K, n) through these rows, and the rows' places in it (N,).

    Every row and, of what lies between, as much as keeps each turning point of a smooth motion.
    """
    whole, place = recording.path
    kept = np.linspace(0, len(whole) - 1, min(len(whole), PATH_ROWS)).astype(np.intp)
    near = np.union1d(kept, place)
    return whole.q[near], np.searchsorted(near, place)


def _of_speed(recording: Recording, j: int) -> Array:
    """Bends of friction over the speed (K, N): what goes with the motion, and what does not."""
    assert recording.velocity is not None
    assert recording.turning is not None
    v, sense = recording.velocity[:, j], recording.turning[:, j]
    u = np.abs(v) / max(float(np.abs(v).max()), 1e-12)
    with_motion = [sense * np.cos(np.pi * k * u) / (1 + (k / 3) ** 2) for k in range(1, COSINES)]
    return np.stack([*with_motion, u, u**2])

"""Every triple of markers as a registration, the best one for a lesion first."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from plumbline.optim.registration.answer import Registration
from plumbline.optim.registration.checks import check
from plumbline.optim.registration.fiducials import Fiducials
from plumbline.optim.registration.options import RegistrationOptions
from plumbline.optim.registration.registering import register
from plumbline.optim.registration.three_point import ThreePoint
from plumbline.optim.registration.triples import Frames, Triple, usable_triples


def rank_triples(recording: Fiducials, lesion: ArrayLike) -> tuple[Registration, ...]:
    """Every usable triple as a registration, in its best order, the best for the lesion first.

    Args:
        recording: Markers in CT and by the robot.
        lesion: What the robot is to find, in CT (3,) [m].

    Raises:
        PlumblineError: The markers cannot be registered, by no triple.
    """
    markers = recording.checked()
    check(markers)
    frames = Frames.of(markers, usable_triples(markers))
    best: dict[tuple[int, ...], Triple] = {}
    for k in np.argsort(frames.tre_squares(np.asarray(lesion, dtype=float)), kind="stable"):
        a, b, c = (int(v) for v in frames.triples[k])
        best.setdefault(tuple(sorted((a, b, c))), (a, b, c))
    found = [register(recording, RegistrationOptions(ThreePoint(t))) for t in best.values()]
    return tuple(sorted(found, key=lambda answer: answer.tre(lesion).rms))

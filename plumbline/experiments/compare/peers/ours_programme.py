"""The banded solver on the programmes of a course: median time of one."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version as version_of
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.benches import mpc
from plumbline.experiments.benches.hpipm import Recording, race
from plumbline.optim.capsule_mpc import RealTime

Array = NDArray[np.float64]
TASKS, OBSTACLES, CHOSEN = 10, 3, 3  # of the course that is driven, and every so manieth programme


def version() -> str:
    """Of plumbline."""
    return version_of("plumbline-robotics")


def fit(given: Mapping[str, Array]) -> Any:
    """Both solvers on the same programmes, in turns."""
    recorded = Recording([])
    mpc.drive("recorded", RealTime(recorded, compiled=False), TASKS, OBSTACLES, 2, 100)
    return race(recorded.kept[::CHOSEN])


def figures(given: Mapping[str, Array], found: Any) -> dict[str, float]:
    """Median of one programme [ms]."""
    return {"error": found.banded[0], "p99": found.banded[1], "apart": found.apart}

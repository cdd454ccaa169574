"""Our fit of offset, delay and lag of every joint's drive, windows rolled out with derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version as version_of
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.drive import Law
from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.effects.actuation_offset import ActuationOffset
from plumbline.optim.diagnosis.motion.fit import evaluated, fitted
from plumbline.optim.diagnosis.motion.rollout import Windows

Array = NDArray[np.float64]
EFFECTS = (ActuationOffset(), ActuationDelay(), ActuationLag())


def version() -> str:
    """Of plumbline."""
    return version_of("plumbline-robotics")


def _windows(given: Mapping[str, Array], joint: int, starts: Array) -> Windows:
    u, q = given["u"][:, joint], given["q"][:, joint]
    nothing = np.zeros(len(q))
    return Windows(
        Law.POSITION, float(given["dt"]), 0.0, 0.0, u, np.zeros(len(q), np.int64), q,
        nothing, nothing, nothing, starts.astype(np.int64), int(given["length"]),
        int(given["settle"]),
    )  # fmt: skip


def fit(given: Mapping[str, Array]) -> Any:
    """Offset, delay and lag (n, 3)."""
    start = given["start"]
    return [
        fitted(_windows(given, j, given["fit"]), EFFECTS, start).theta
        for j in range(given["q"].shape[1])
    ]


def figures(given: Mapping[str, Array], found: Any) -> dict[str, float]:
    """RMS on windows not fitted [mrad]."""
    squares = [
        evaluated(_windows(given, j, given["judge"]), EFFECTS, theta).square
        for j, theta in enumerate(found)
    ]
    return {"error": 1e3 * float(np.sqrt(np.mean(squares)))}

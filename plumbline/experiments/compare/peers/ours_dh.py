"""Our link fit with frame and tool, loss the square as the others have it."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version as version_of
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plumbline.kinematics.robot import Robot
from plumbline.optim.dh_fit import DHOptions, Misfit, Readings, Squares, fit_dh
from plumbline.optim.recording.building import build_recording

Array = NDArray[np.float64]


def version() -> str:
    """Of plumbline."""
    return version_of("plumbline-robotics")


def fit(given: Mapping[str, Array]) -> Any:
    """The fit of the rows."""
    keys = ("d", "a", "alpha", "theta")
    rows = [dict(zip(keys, map(float, row), strict=True)) for row in given["dh"]]
    recording = build_recording(
        observation="tip_position", robot=Robot.from_dh(rows), q=given["q"],
        measured=given["tips"], tool_offset=given["tool"],
    )  # fmt: skip
    return fit_dh(recording, DHOptions(loss=Squares()))


def figures(given: Mapping[str, Array], found: Any) -> dict[str, float]:
    """RMS on rows not fitted [mm]."""
    unseen = Readings(given["q_new"], given["tips_new"])
    return {"error": 1e3 * Misfit.of(found.misfits(unseen)).rms}

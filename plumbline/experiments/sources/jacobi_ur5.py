r"""UR5 under a laser tracker: reading Jacobi's tables.

The tracker was registered to the robot beforehand. A row gives the commanded joints [deg], the
target of the tip and the error :math:`e = x_{target} - x_{actual}` [mm], both in the robot's base:

.. math:: x = 10^{-3} (x_{target} - e).

Jacobi, P., A Hybrid Error Compensation Method for Enhancing the Pose Accuracy of Serial Industrial
Robots, Master's thesis, Tsinghua University, 2025.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from plumbline.experiments.sources.catalogue import Source, pinned
from plumbline.experiments.sources.folder import Draft, tip_draft

TOOL = 0.031  # [m] along the flange's z: joints and targets agree to 0.012 mm RMS with it

NOTES = (
    "Joints are the commanded ones [rad]; the tip is target - error [m], as the source defines its",
    "error as target minus actual. Frame: the robot's base, as the source registered it.",
    "Nominal tool: 31 mm along the flange's z, with which the nominal chain at the commanded",
    "joints gives the source's targets back. Every row of the source is here, in its order.",
    "The tracker's specified accuracy is 15 um + 6 um/m; it is no standard deviation and leaves",
    "out the robot's repeatability (0.1 mm), so noise_std is left to be estimated.",
)


BASE = Source(
    name="ur5-grid",
    robot="UR5",
    instrument="GTS3800 laser tracker",
    rows=1000,
    licence="MIT, Copyright (c) 2025 Paul Jacobi",
    repository="pauljac7700/serial_robots_datasets",
    commit="759068d85a8b95183cd71ff96d9dfc5173bc57fc",
    folder="jacobi_ur5_wam",
    files=pinned(
        "UR5/3D_UR5_uncalibrated_grid_cleaned.csv",
        "3de63c38b4338a1fb23437a9c6ecb7e0441a9e132fc055544619b8c580f767c0",
    ),
    citation=(
        "Jacobi, P. (2025). A Hybrid Error Compensation Method for Enhancing the Pose Accuracy "
        "of Serial Industrial Robots. Master's thesis, Department of Mechanical Engineering, "
        "Tsinghua University."
    ),
    description="UR5 tip over a grid of poses, commanded joints",
)
RANDOM = replace(
    BASE,
    name="ur5-random",
    rows=20,
    files=pinned(
        "UR5/3D_UR5_uncalibrated_random_cleaned.csv",
        "3cd7a4aae072f9757ce9bd156e7470cc8caa89d8af9164c07390953ae808095a",
    ),
    description="UR5 tip in random poses, commanded joints; the test set of ur5-grid",
)
SOURCES = (BASE, RANDOM)


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of one table: commanded joints and tip position."""
    table = pd.read_csv(local[source.files[0].path])
    joints = np.radians(table[[f"joint_{j}" for j in range(1, 7)]].to_numpy(dtype=float))
    columns = {f"q{j + 1}": joints[:, j] for j in range(6)}
    for axis in "xyz":
        target = table[f"{axis}_t"].to_numpy(dtype=float)
        error = table[f"{axis}_dif"].to_numpy(dtype=float)
        columns[axis] = (target - error) / 1e3
    return tip_draft("ur5", TOOL, NOTES, columns)

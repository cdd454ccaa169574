r"""UR10 followed by a laser tracker: reading Landgraf and others' tables.

The tracker's T-Mac rides on the flange. With :math:`T_{LB}` from the robot's base to the tracker
and :math:`t` the T-Mac in the flange, a row measures

.. math:: p_L = T_{LB} T_{BF}(q) t.

The tables have `;` between cells and a decimal comma; joints in rad, positions in mm.

Landgraf, C. et al., A Hybrid Neural Network Approach for Increasing the Absolute Accuracy of
Industrial Robots, CASE 2021, pp. 468-474.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from plumbline.experiments.sources.cache import Source
from plumbline.experiments.sources.folder import Draft, tip_draft
from plumbline.kinematics.robot import makers_joints

LONGEST_STEP = 30.0  # [s] a longer step has motion in between that was not recorded
SMALLEST_STEP = 1e-3  # [rad] a smaller one is within the controller's own wander about a target
TMAC = 0.109  # [m] along the flange's z, from the source's Trafo_TM_F_init.txt


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of one series: joints, tip, temperature and, for series A, time and direction."""
    table = pd.read_csv(local[source.files[0].path], sep=";", decimal=",")
    timed = source.name == "ur10-grid"
    if timed:
        stamps = table["Timestamp"].astype("int64").astype(str)
        moments = pd.to_datetime(stamps, format="%Y%m%d%H%M%S")
        since = (moments - moments.min()).dt.total_seconds()
        table = table.assign(time=since).sort_values("time", kind="stable")
    joints = table[list(makers_joints("ur10"))].to_numpy(dtype=float)
    columns = {f"q{j + 1}": joints[:, j] for j in range(6)}
    for axis in "xyz":
        columns[axis] = table[f"measurement_{axis}"].to_numpy(dtype=float) / 1e3
    columns["temperature"] = table["measurement_temperature"].to_numpy(dtype=float)
    if timed:
        time = table["time"].to_numpy(dtype=float)
        columns["time"] = time
        sides = approach_sides(joints, time)
        columns |= {f"direction{j + 1}": sides[:, j] for j in range(6)}
    return tip_draft("ur10", TMAC, columns)


def approach_sides(joints: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.int_]:
    """Side from which each joint reached its place, point to point: -1, 0 (unknown) or 1, (N, n).

    By joint readings (N, n) [rad] in order of time (N,) [s].
    """
    step = np.diff(joints, axis=0, prepend=joints[:1])
    known = np.diff(time, prepend=-np.inf) <= LONGEST_STEP
    moved = np.abs(step) >= SMALLEST_STEP
    return np.where(known[:, None] & moved, np.sign(step), 0.0).astype(int)

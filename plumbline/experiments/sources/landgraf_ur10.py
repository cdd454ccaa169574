r"""UR10 followed by a laser tracker: reading Landgraf and others' tables.

The tracker's T-Mac rides on the flange. With :math:`T_{LB}` from the robot's base to the tracker
and :math:`t` the T-Mac in the flange, a row measures

.. math:: p_L = T_{LB} T_{BF}(q) t.

The tables have `;` between cells and a decimal comma; joints in rad, positions in mm.

Landgraf, C. et al., A Hybrid Neural Network Approach for Increasing the Absolute Accuracy of
Industrial Robots, CASE 2021, pp. 468-474.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from plumbline.experiments.sources.catalogue import Source, pinned
from plumbline.experiments.sources.folder import Draft, tip_draft

LONGEST_STEP = 30.0  # [s] a longer step has motion in between that was not recorded
SMALLEST_STEP = 1e-3  # [rad] a smaller one is within the controller's own wander about a target
JOINTS = tuple(
    f"{name}_joint"
    for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
)
TMAC = 0.109  # [m] along the flange's z, from the source's Trafo_TM_F_init.txt


GRID = Source(
    name="ur10-grid",
    robot="UR10 (CB3)",
    instrument="laser tracker with a T-Mac 6-D probe",
    rows=11911,
    licence="MIT, Copyright (c) 2021 Christian Landgraf",
    repository="christianlandgraf/ipa-robot-accuracy",
    commit="507fba69bdaf6c43c2faf306e70a7e37c5e39b89",
    folder="landgraf_ur10",
    files=pinned(
        "Series_A/measurements_grid.csv",
        "84d5c81234cab58ebe88b4c73c582c26ad0e407f0de5350571c91f5ce6f28b76",
    ),
    citation=(
        "Landgraf, C., Ernst, K., Schleth, G., Fabritius, M., Huber, M. F. (2021). A Hybrid "
        "Neural Network Approach for Increasing the Absolute Accuracy of Industrial Robots. "
        "IEEE CASE 2021, pp. 468-474."
    ),
    description="UR10 flange over a grid of poses, with time and ambient temperature (series A)",
)
CONFIGURATIONS = replace(
    GRID,
    name="ur10-joints",
    rows=1495,
    files=pinned(
        "Series_B/measurements_joint_configurations.csv",
        "12b69a4e6ff7be68e67d3f70245a3ab7bb6ec3a2c63bc5eae002b15a1f863d7e",
    ),
    description="UR10 flange in several joint configurations a pose, with temperature (series B)",
)
SOURCES = (GRID, CONFIGURATIONS)

COMMON_NOTES = (
    "Joints as read from the controller [rad], tip (T-Mac) in the tracker's frame [m].",
    "The T-Mac's nominal place is the source's Trafo_TM_F_init.txt, 109 mm along the flange's z;",
    "its rotation and the measured angles rx, ry, rz are left out. No row of the source is.",
    "The source states no noise of the tip, so noise_std is left to be estimated.",
)
GRID_NOTES = (
    "Rows are in order of time: the source has ten of them out of place (one in the middle, nine",
    "at the end). time [s] counts from the first row; the clock reads whole seconds. The rows span",
    "100.8 h on five days, with stops of up to 20.7 h.",
    "direction: sign of the joint's step from the row before, as each pose was reached from the",
    "one before it; 0 (unknown) where the step took longer than 30 s, as motion in between may be",
    "unrecorded, or is below 1 mrad. A planned path need not be straight in joint space: for long",
    "steps the side of the last approach is likely, not certain.",
)
JOINTS_NOTES = (
    "No time: the source's timestamps are cut to six digits, the same number in every row. Rows",
    "are in the source's order, and the temperature changes in steps of one digit along it.",
    "No direction: neighbouring rows are different configurations of the arm, and the paths",
    "between them are not recorded.",
    "The source's standard deviation within one measurement has a median of 0.010 to 0.012 mm an",
    "axis: the tracker's share alone, without the robot's repeatability.",
)


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of one series: joints, tip, temperature and, for series A, time and direction."""
    table = pd.read_csv(local[source.files[0].path], sep=";", decimal=",")
    timed = source.name == GRID.name
    if timed:
        table = table.assign(time=_seconds(table["Timestamp"])).sort_values("time", kind="stable")
    joints = table[list(JOINTS)].to_numpy(dtype=float)
    columns = {f"q{j + 1}": joints[:, j] for j in range(6)}
    for axis in "xyz":
        columns[axis] = table[f"measurement_{axis}"].to_numpy(dtype=float) / 1e3
    columns["temperature"] = table["measurement_temperature"].to_numpy(dtype=float)
    if timed:
        time = table["time"].to_numpy(dtype=float)
        columns["time"] = time
        sides = approach_sides(joints, time)
        columns |= {f"direction{j + 1}": sides[:, j] for j in range(6)}
    return tip_draft("ur10", TMAC, COMMON_NOTES + (GRID_NOTES if timed else JOINTS_NOTES), columns)


def approach_sides(joints: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.int_]:
    """Side from which each joint reached its place, from point to point motion.

    Args:
        joints: joint readings in order of time (N, n) [rad].
        time: time of each row (N,) [s].

    Returns:
        -1, 0 (unknown) or 1 for each row and joint (N, n).
    """
    step = np.diff(joints, axis=0, prepend=joints[:1])
    known = np.diff(time, prepend=-np.inf) <= LONGEST_STEP
    moved = np.abs(step) >= SMALLEST_STEP
    return np.where(known[:, None] & moved, np.sign(step), 0.0).astype(int)


def _seconds(stamps: pd.Series[int]) -> pd.Series[float]:
    """Seconds since the earliest of the timestamps `YYYYMMDDhhmmss`."""
    moments = pd.to_datetime(stamps.astype("int64").astype(str), format="%Y%m%d%H%M%S")
    return (moments - moments.min()).dt.total_seconds()

r"""UR10 with joint states at 125 Hz: reading the exciting trajectory of the University of Salerno.

A bag of ROS 2 (SQLite) with one topic of ``sensor_msgs/msg/JointState``; efforts are those that the
controller makes of motor currents [N m]. The last 40 % of the time are kept from every fit.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from plumbline.experiments.importing.bags import read
from plumbline.experiments.sources.cache import Source
from plumbline.experiments.sources.folder import Draft
from plumbline.kinematics.robot import makers_joints

PREFIXES = {"q": "position", "velocity": "velocity", "effort": "effort"}
BLOCK = 1.5  # s: neighbours are 8 ms apart and alike; left out together
FITTED = 0.6  # share of the time that may be fitted


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of the run: joints, velocities and efforts over time."""
    table = next(t for t in read(local[source.files[0].path]) if t.name == "/joint_states")
    time = np.asarray(table.columns["stamp"], dtype=float)
    time = np.round(time - time[0], 6)
    columns = {"time": time}
    for prefix, name in PREFIXES.items():
        columns |= {
            f"{prefix}{j}": table.columns[f"{name}.{n}"]
            for j, n in enumerate(makers_joints("ur10"), 1)
        }
    late = time >= FITTED * time[-1]
    blocks = np.floor(time / BLOCK + 1e-9).astype(int)
    columns["group"] = np.where(late, blocks.max() + 1, blocks)
    columns["held_out"] = late.astype(int)
    robot = {"description": "ur10", "tip_frame": "tool0"}
    tables = {"robot": robot, "motion": {"effort_unit": "N m"}}
    return Draft("joint_torque", {}, tables, pd.DataFrame(columns))

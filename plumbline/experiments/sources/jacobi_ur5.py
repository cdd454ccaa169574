r"""UR5 under a laser tracker: reading Jacobi's tables.

The tracker was registered to the robot beforehand. A row gives the commanded joints [deg], the
target of the tip and the error :math:`e = x_{target} - x_{actual}` [mm], both in the robot's base:

.. math:: x = 10^{-3} (x_{target} - e).

Jacobi, P., A Hybrid Error Compensation Method for Enhancing the Pose Accuracy of Serial Industrial
Robots, Master's thesis, Tsinghua University, 2025.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from plumbline.experiments.sources.cache import Source
from plumbline.experiments.sources.folder import Draft, tip_draft

TOOL = 0.031  # [m] along the flange's z: joints and targets agree to 0.012 mm RMS with it


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of one table: commanded joints and tip position."""
    table = pd.read_csv(local[source.files[0].path])
    joints = np.radians(table[[f"joint_{j}" for j in range(1, 7)]].to_numpy(dtype=float))
    columns = {f"q{j + 1}": joints[:, j] for j in range(6)}
    for axis in "xyz":
        target = table[f"{axis}_t"].to_numpy(dtype=float)
        error = table[f"{axis}_dif"].to_numpy(dtype=float)
        columns[axis] = (target - error) / 1e3
    return tip_draft("ur5", TOOL, columns)

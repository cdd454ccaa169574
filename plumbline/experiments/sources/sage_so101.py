r"""SO-101's motions: reading the commands and the servos' states of the SAGE project.

Each line holds a time stamp [µs] and a list of six positions [rad]. Commands run straight between
their stamps, so that they are had at the times of the readings,

.. math:: u(t_k) = u_i + (t_k - t_i)\, (u_{i+1} - u_i) / (t_{i+1} - t_i).
"""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from plumbline.experiments.sources.cache import Source
from plumbline.experiments.sources.folder import Draft

JOINTS = 6  # the gripper among them


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of one motion: commanded and measured positions."""
    asked, command = _read(local[source.files[0].path])
    read, q = _read(local[source.files[1].path])
    u = np.column_stack([np.interp(read, asked, column) for column in command.T])
    columns = {"time": read - read[0]}
    columns |= {f"u{j + 1}": u[:, j] for j in range(JOINTS)}
    columns |= {f"q{j + 1}": q[:, j] for j in range(JOINTS)}
    tables = {"robot": {"description": "so101"}, "motion": {"command": "position"}}
    return Draft("motion", {}, tables, pd.DataFrame(columns))


def _read(file: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    table = pd.read_csv(file)
    positions = np.array([json.loads(cell) for cell in table["positions"]], dtype=float)
    return table["timestamp"].to_numpy(dtype=float) * 1e-6, positions[:, :JOINTS]

r"""KR300 with second encoders: reading the recorded trajectory of Weigand and others.

The motor's reading :math:`q` is already divided by the gear ratio :math:`u`; the second encoder
reads the link :math:`m`. The drive's torque is given on the motor's side, where the source's model

.. math:: M(q) \ddot q + C \dot q + g(q) + \tau_f = u \, \tau_{motor}

has it; the recording holds :math:`u \tau_{motor}`, which still contains friction and the motor's
own inertia. With torsional stiffness :math:`c` the link lags, :math:`m = q - \tau / c`.

Weigand, J., Ulmen, J., Janot, A., Ruskowski, M., Real-time nonlinear parameter identification for
an industrial robot, 2021.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.io import loadmat

from plumbline.experiments.sources.cache import Source
from plumbline.experiments.sources.folder import Draft, Value

#: [deg] the arm's place when its counters read zero, added to give the Denavit-Hartenberg joints.
ZERO = (0.0, -90.0, 90.0, 0.0, 0.0, 0.0)
MEASURED = (1, 2, 3)  # joints whose second encoder works
AT_REST = np.radians(0.05)  # [rad/s] slower than this, the last direction still holds
BLOCK = 1.0  # [s] neighbours are 4 ms apart: leave whole blocks out, never single rows


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of the run: motor and link encoders, velocity, effort, direction, time, group."""
    content = loadmat(
        local[source.files[0].path],
        variable_names=["rec", "para"],
        squeeze_me=True,
        struct_as_record=False,
    )
    record, ratios = content["rec"], np.asarray(content["para"].u, dtype=float)
    # Stored in single precision: 0.00399999990 is 0.004.
    time = np.round(np.asarray(record.time_cont, dtype=float), 6)
    velocity = np.radians(record.act_vel_mot_deg_per_s.T)
    link = np.radians(record.act_pos_se_deg.T + np.array(ZERO))
    link[:, [j for j in range(6) if j + 1 not in MEASURED]] = np.nan
    columns: dict[str, NDArray[np.float64] | NDArray[np.int_]] = {"time": time}
    for prefix, values in {
        "q": np.radians(record.act_pos_mot_deg.T + np.array(ZERO)),
        "m": link,
        "velocity": velocity,
        "effort": record.act_torque_abs_nm.T * ratios,
        "direction": held_direction(velocity),
    }.items():
        columns |= {f"{prefix}{j + 1}": values[:, j] for j in range(6)}
    # The last sample, at 10 s sharp, belongs to the last whole block.
    columns["group"] = np.floor(np.minimum(time, time[-1] - BLOCK / 2) / BLOCK + 1e-9).astype(int)
    settings: dict[str, Value] = {"measured_joints": list(MEASURED)}
    tables: dict[str, dict[str, Value]] = {
        "robot": {"bundled": "kr300", "tip_frame": "flange", "gravity": [0.0, 0.0, 9.81]},
        "tool": {"offset": [0.0, 0.0, 0.0]},
        "fit": {"always": ["joint_offset"]},
        "gears": {"ratio": [float(ratio) for ratio in ratios]},
    }
    return Draft("joint_position", settings, tables, pd.DataFrame(columns))


def held_direction(velocity: NDArray[np.float64]) -> NDArray[np.int_]:
    """Direction of the last motion along a trajectory: -1, 0 (no motion yet) or 1, (N, n).

    By joint velocities (N, n) [rad/s] in order of time.
    """
    moving = np.abs(velocity) > AT_REST
    rows = np.arange(len(velocity))[:, None]
    last = np.maximum.accumulate(np.where(moving, rows, -1), axis=0)
    held = np.take_along_axis(np.sign(velocity), np.maximum(last, 0), axis=0)
    return np.where(last >= 0, held, 0.0).astype(int)

r"""KR300 with second encoders: reading the recorded trajectory of Weigand and others.

The motor's reading :math:`q` is already divided by the gear ratio :math:`u`; the second encoder
reads the link :math:`m`. The drive's torque is given on the motor's side, where the source's model

.. math:: M(q) \ddot q + C \dot q + g(q) + \tau_f = u \, \tau_{motor}

has it; the recording holds :math:`u \tau_{motor}`, which still contains friction and the motor's
own inertia. With torsional stiffness :math:`c` the link lags, :math:`m = q - \tau / c`.

Weigand, J., Ulmen, J., Janot, A., Ruskowski, M., Real-time nonlinear parameter identification for
an industrial robot, 2021.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.io import loadmat

from plumbline.experiments.sources.catalogue import Source, pinned
from plumbline.experiments.sources.folder import Draft, Value

MAT_FILE = "data/recorded_trajectories/2020-10-21 10s FF A 08ms/data.mat"
#: [deg] the arm's place when its counters read zero, added to give the Denavit-Hartenberg joints.
ZERO = (0.0, -90.0, 90.0, 0.0, 0.0, 0.0)
MEASURED = (1, 2, 3)  # joints whose second encoder works
AT_REST = np.radians(0.05)  # [rad/s] slower than this, the last direction still holds
BLOCK = 1.0  # [s] neighbours are 4 ms apart: leave whole blocks out, never single rows

SOURCES = (
    Source(
        name="kr300",
        robot="KUKA KR300 R2500 ultra SE",
        instrument="second encoders on the link side of joints 1 to 3",
        rows=2501,
        licence="MIT, Copyright (c) 2021 Jonas Weigand",
        repository="JonasWeigand/Robot_Identification",
        commit="9e403c07d9dadbb391a9f3921e8d219f714636a8",
        folder="weigand_kr300",
        files=pinned(MAT_FILE, "4c152c5b7f2c899731fdeebcf0d011cc103df72be19fac160caf47aa9b73ab75"),
        citation=(
            "Weigand, J., Ulmen, J., Janot, A., Ruskowski, M. (2021). Real-time nonlinear "
            "parameter identification for an industrial robot. Code and measurements, "
            "https://github.com/JonasWeigand/Robot_Identification."
        ),
        description="KR300 motor and link encoders, velocity and torque over 10 s at 4 ms",
    ),
)

NOTES = (
    "q: motor encoder referred to the link [rad], m: second encoder on the link [rad], velocity:",
    "from the motor's encoder, referred to the link [rad/s]. The source counts joints from the",
    "start of the run; 0, -90, 90, 0, 0, 0 deg are added to q and m, the zero of its model.",
    "m4..m6 are empty: the source's second encoders of joints 4 to 6 read zero throughout.",
    "m - q holds a constant for each joint, the encoders' zeros (mean -0.08, -0.01, 0.14 deg on",
    "J1..J3): a matter of mounting, so always fitted and never blamed. Beyond it m - q goes mostly",
    "with velocity, -3.1, -3.1 and -3.0 ms times it, as if the two encoders were read at different",
    "moments; torque and direction go with velocity too.",
    "effort: drive torque on the motor's side times the gear ratio [Nm], positive with q, what the",
    "drive exerts; it still holds friction and the motor's inertia.",
    "A hydraulic counterbalance acts on joint 2 and is no part of the rigid-body model: the load",
    "of joint 2 is in effort, not in the model's gravity alone. The payload is not stated.",
    "gravity points along the base's +z: in the model's Denavit-Hartenberg rows z points down.",
    "direction: sign of velocity, held where slower than 0.05 deg/s; 0 before the first motion.",
    "group: blocks of 1 s, left out together as rows 4 ms apart are nearly the same.",
)


def convert(source: Source, local: Mapping[str, Path]) -> Draft:
    """Recording of the run.

    Returns:
        The recording: motor and link encoders, velocity, effort, direction, time and group.
    """
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
    return Draft("joint_position", NOTES, settings, tables, pd.DataFrame(columns))


def held_direction(velocity: NDArray[np.float64]) -> NDArray[np.int_]:
    """Direction of the last motion along a trajectory.

    Args:
        velocity: joint velocities in order of time (N, n) [rad/s].

    Returns:
        -1, 0 (no motion yet) or 1 for each row and joint (N, n).
    """
    moving = np.abs(velocity) > AT_REST
    rows = np.arange(len(velocity))[:, None]
    last = np.maximum.accumulate(np.where(moving, rows, -1), axis=0)
    held = np.take_along_axis(np.sign(velocity), np.maximum(last, 0), axis=0)
    return np.where(last >= 0, held, 0.0).astype(int)

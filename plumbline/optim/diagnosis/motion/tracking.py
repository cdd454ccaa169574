r"""Recordings of a controlled tip (``observation = "tracking"``): rates asked for, states measured.

``samples.csv`` has ``time`` [s], commanded velocities ``u1..un`` [m/s] and the measured state
``x1..xn`` [m] of one instrument or several, three columns a tip; ``group`` and ``held_out`` if
wanted. A command is what was sent at its row's time, and it stands until the next one:
:math:`\dot x(t) = u_k` for :math:`t_k \le t < t_{k+1}` is the ideal drive of an axis. There is no
robot: each axis is a drive of its own, and a tenth of a metre is to it what a radian is to a joint.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.kinematics.law import Law
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.motion import recording
from plumbline.optim.recording.columns import numbered
from plumbline.optim.recording.loading import KEYS, PROVENANCE, open_folder
from plumbline.optim.recording.recording import hash_of
from plumbline.optim.recording.table import Array, Origin


def build_tracking(
    *,
    time: ArrayLike,
    rate: ArrayLike,
    x: ArrayLike,
    group: ArrayLike | None = None,
    held_out: ArrayLike | None = None,
    noise_std: float | None = None,
    name: str = "arrays",
) -> recording.MotionRecording:
    """A checked recording of a controlled tip from arrays.

    Args:
        time: Time (N,) [s], ascending within a group.
        rate: Commanded velocities (N, n) [m/s], each held until the next row's time.
        x: Measured states (N, n) [m].
        group: Motion (N,): what is left out together.
        held_out: Rows (N,) that no fit may see.
        noise_std: Noise of a measured state, 1 sigma [m].
        name: What to call it.

    Raises:
        PlumblineError: The arrays cannot be used; the message says why and what to do.
    """
    t, u, measured = recording.in_rows("time, rate, x", time, rate, x)
    return _of_axes(
        Origin(), t, u, measured, name=name,
        group=None if group is None else np.asarray(group, dtype=np.int64),
        held_out=None if held_out is None else np.asarray(held_out, dtype=bool),
        noise_std=noise_std,
        sha256=hash_of(*(a.tobytes() for a in (t, u, measured))), notes=(),
    )  # fmt: skip


def load_tracking(folder: str | Path) -> recording.MotionRecording:
    """Read and check a recording of a controlled tip.

    Raises:
        PlumblineError: The folder cannot be used; one line says where, why and how to mend it.
    """
    opened = open_folder(folder)
    opened.must_be(recording.TRACKING, "commanded rates")
    settings, table = opened.settings, opened.table
    table.require(("time", "u1", "x1"))
    count = max(numbered(table.columns, "x"))
    names = [[f"{prefix}{k}" for k in range(1, count + 1)] for prefix in ("u", "x")]
    held = recording.whole(table, "held_out")
    used = ["time", "group", "held_out", *names[0], *names[1]]
    return _of_axes(
        opened.origin, table.numbers("time"), table.block(names[0]), table.block(names[1]),
        name=opened.name, group=recording.whole(table, "group"),
        held_out=None if held is None else held == 1,
        noise_std=settings.number("noise_std"), sha256=opened.sha256(b""),
        notes=(*settings.unused((*KEYS, *PROVENANCE)), *table.notes, *table.unused(used)),
    )  # fmt: skip


def load_drives(folder: str | Path) -> recording.MotionRecording:
    """Read and check a recording of joints under commands, or of a controlled tip.

    Raises:
        PlumblineError: The folder cannot be used; one line says where, why and how to mend it.
    """
    tip = open_folder(folder).settings.word("observation") == recording.TRACKING
    return load_tracking(folder) if tip else recording.load_motion(folder)


def _of_axes(
    origin: Origin, t: Array, u: Array, x: Array, **more: Any
) -> recording.MotionRecording:
    n = x.shape[1]
    axes = Robot.from_dh([{"kind": "prismatic"}] * n, name="axes", gravity=(0.0, 0.0, 0.0))
    joints = tuple(f"x{k}" for k in range(1, n + 1))
    nothing = np.zeros(n)
    return recording.checked(
        origin, robot=axes, joints=joints, index=tuple(range(n)), law=Law.RATE, time=t,
        command=u, q=x, kp=nothing, kd=nothing, observation=recording.TRACKING, **more,
    )  # fmt: skip

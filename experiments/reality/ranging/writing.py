"""A survey as a recording folder of kind ``plane_range``: ``dataset.toml`` and ``samples.csv``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from experiments.reality.arm import Array, forward
from experiments.reality.ranging.room import Room, Survey
from experiments.reality.recorder import quaternions


def write_survey(
    folder: Path, room: Room, survey: Survey, marks: Survey | None = None, *, poses: bool = False
) -> Path:
    """Write readings, and marks if there are any, by joint readings or by flange poses.

    Args:
        folder: Where to; made if it is not there.
        room: The room, whose instrument states its noise.
        survey: Readings on the boards.
        marks: Readings of marks.
        poses: Flange poses rather than joint readings.
    """
    folder.mkdir(parents=True, exist_ok=True)
    parts = [survey] if marks is None else [survey, marks]
    q = np.concatenate([part.q for part in parts])
    columns = _flange(room, q) if poses else {f"q{i + 1}": q[:, i] for i in range(q.shape[1])}
    columns |= {
        "range": np.concatenate([part.distance for part in parts]),
        "plane": np.concatenate([part.plane for part in parts]),
        "motion": np.concatenate([part.motion for part in parts]),
    }
    if marks is not None:
        number = np.concatenate([np.zeros(len(survey.q), dtype=np.int64), marks.patch + 1])
        columns["mark"] = number
    lines = [",".join(columns)]
    lines += [",".join(f"{v:.9g}" for v in row) for row in zip(*columns.values(), strict=True)]
    (folder / "samples.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    settings = [
        f'name = "{folder.name}"',
        'observation = "plane_range"',
        f"noise_std = {room.instrument.noise:.6g}",
        "",
        "[robot]",
        f'bundled = "{room.arm.name}"',
        f'tip_frame = "{room.arm.tip_frame}"',
    ]
    (folder / "dataset.toml").write_text("\n".join(settings) + "\n", encoding="utf-8")
    return folder


def _flange(room: Room, q: Array) -> dict[str, Array]:
    """Columns of the flange's poses, as the encoders have them."""
    T = forward(room.arm, q)[:, -1]
    values = np.hstack([T[:, :3, 3], quaternions(T[:, :3, :3])])
    names = ("px", "py", "pz", "qw", "qx", "qy", "qz")
    return dict(zip(names, values.T, strict=True))

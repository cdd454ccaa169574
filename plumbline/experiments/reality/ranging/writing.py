"""Surveys as recordings, of kind ``plane_range``."""

from pathlib import Path

import numpy as np

from plumbline.experiments.reality import recorder
from plumbline.experiments.reality.arm import Arm, Array, forward
from plumbline.experiments.reality.ranging.scene import Scene, Survey


def write_survey(
    folder: Path, scene: Scene, survey: Survey, marks: Survey | None = None, *, poses: bool = False
) -> Path:
    """Write readings, and marks if there are any, by joint readings or by flange poses."""
    parts = [survey] if marks is None else [survey, marks]
    q = np.concatenate([part.q for part in parts])
    columns = flange_columns(scene.arm, q) if poses else recorder.numbered("q", q)
    columns |= {
        "range": np.concatenate([part.distance for part in parts]),
        "plane": np.concatenate([part.plane for part in parts]),
        "motion": np.concatenate([part.motion for part in parts]),
    }
    if marks is not None:
        number = np.concatenate([np.zeros(len(survey.q), dtype=np.int64), marks.patch + 1])
        columns["mark"] = number
    text = f'name = "{folder.name}"\nobservation = "plane_range"\n'
    text += f"noise_std = {scene.instrument.noise:.6g}\n\n[robot]\n"
    text += f'bundled = "{scene.arm.name}"\ntip_frame = "{scene.arm.tip_frame}"\n'
    recorder.write(folder, recorder.Recording(text, columns))
    return folder


def flange_columns(arm: Arm, q: Array) -> dict[str, Array]:
    """Columns of the flange's poses at joint readings (N, n), as the encoders have them."""
    T = forward(arm, q)[:, -1]
    values = np.hstack([T[:, :3, 3], recorder.quaternions(T[:, :3, :3])])
    names = ("px", "py", "pz", "qw", "qx", "qy", "qz")
    return dict(zip(names, values.T, strict=True))

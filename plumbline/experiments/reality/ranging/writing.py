"""Surveys and scans as recordings, of kind ``plane_range`` and ``surface_scan``."""

from pathlib import Path
from typing import Any

import numpy as np

from plumbline.experiments.reality import recorder
from plumbline.experiments.reality.arm import Arm, Array, forward
from plumbline.experiments.reality.ranging.phantoms import Head, Scan
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
    noise = f"noise_std = {scene.instrument.noise:.6g}\n"
    return _written(folder, scene, "plane_range", columns, noise)


def _written(
    folder: Path, scene: Scene, observation: str, columns: dict[str, Any], noise: str = ""
) -> Path:
    text = f'name = "{folder.name}"\nobservation = "{observation}"\n{noise}\n[robot]\n'
    text += f'bundled = "{scene.arm.name}"\ntip_frame = "{scene.arm.tip_frame}"\n'
    recorder.write(folder, recorder.Recording(text, columns))
    return folder


def flange_columns(arm: Arm, q: Array) -> dict[str, Array]:
    """Columns of the flange's poses at joint readings (N, n), as the encoders have them."""
    T = forward(arm, q)[:, -1]
    values = np.hstack([T[:, :3, 3], recorder.quaternions(T[:, :3, :3])])
    names = ("px", "py", "pz", "qw", "qx", "qy", "qz")
    return dict(zip(names, values.T, strict=True))


def write_block(folder: Path, scene: Scene, scan: Scan) -> Path:
    """Write a scan of a block, its faces numbered from 1."""
    return _write_scan(folder, scene, scan, {"face": np.asarray(scan.part + 1, dtype=float)})


def write_head(
    folder: Path, scene: Scene, scan: Scan, head: Head, landmarks: tuple[Array, Array]
) -> Path:
    """Write a scan of a head, its surface in CT, landmarks in base and CT, and targets."""
    _write_scan(folder, scene, scan, {})
    base, ct = ("base_x", "base_y", "base_z"), ("ct_x", "ct_y", "ct_z")
    recorder.write_table(folder / "surface.csv", dict(zip("xyz", head.surface.T, strict=True)))
    marks = np.hstack(landmarks)
    recorder.write_table(folder / "landmarks.csv", dict(zip((*base, *ct), marks.T, strict=True)))
    numbers = np.arange(1.0, len(head.targets) + 1.0)
    targets = dict(zip(ct, head.targets.T, strict=True))
    recorder.write_table(folder / "targets.csv", {"label": numbers, **targets})
    return folder


def _write_scan(folder: Path, scene: Scene, scan: Scan, more: dict[str, Array]) -> Path:
    columns = {**recorder.numbered("q", scan.q), "range": scan.distance, **more}
    return _written(folder, scene, "surface_scan", columns)

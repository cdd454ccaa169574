"""Surveys and scans as recordings, of kind ``plane_range`` and ``surface_scan``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plumbline.experiments.reality.arm import Array, forward
from plumbline.experiments.reality.ranging.phantoms import Head, Scan
from plumbline.experiments.reality.ranging.scene import Scene, Survey
from plumbline.experiments.reality.recorder import quaternions, write_table


def write_survey(
    folder: Path, scene: Scene, survey: Survey, marks: Survey | None = None, *, poses: bool = False
) -> Path:
    """Write readings, and marks if there are any, by joint readings or by flange poses."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = [survey] if marks is None else [survey, marks]
    q = np.concatenate([part.q for part in parts])
    columns = _flange(scene, q) if poses else {f"q{i + 1}": q[:, i] for i in range(q.shape[1])}
    columns |= {
        "range": np.concatenate([part.distance for part in parts]),
        "plane": np.concatenate([part.plane for part in parts]),
        "motion": np.concatenate([part.motion for part in parts]),
    }
    if marks is not None:
        number = np.concatenate([np.zeros(len(survey.q), dtype=np.int64), marks.patch + 1])
        columns["mark"] = number
    write_table(folder / "samples.csv", columns)
    return _settings(folder, scene, "plane_range", f"noise_std = {scene.instrument.noise:.6g}\n")


def _settings(folder: Path, scene: Scene, observation: str, noise: str = "") -> Path:
    text = f'name = "{folder.name}"\nobservation = "{observation}"\n{noise}\n[robot]\n'
    text += f'bundled = "{scene.arm.name}"\ntip_frame = "{scene.arm.tip_frame}"\n'
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return folder


def _flange(scene: Scene, q: Array) -> dict[str, Array]:
    """Columns of the flange's poses, as the encoders have them."""
    T = forward(scene.arm, q)[:, -1]
    values = np.hstack([T[:, :3, 3], quaternions(T[:, :3, :3])])
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
    write_table(folder / "surface.csv", dict(zip("xyz", head.surface.T, strict=True)))
    marks = np.hstack(landmarks)
    write_table(folder / "landmarks.csv", dict(zip((*base, *ct), marks.T, strict=True)))
    numbers = np.arange(1.0, len(head.targets) + 1.0)
    targets = dict(zip(ct, head.targets.T, strict=True))
    write_table(folder / "targets.csv", {"label": numbers, **targets})
    return folder


def _write_scan(folder: Path, scene: Scene, scan: Scan, more: dict[str, Array]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    columns = {f"q{i + 1}": scan.q[:, i] for i in range(scan.q.shape[1])}
    write_table(folder / "samples.csv", {**columns, "range": scan.distance, **more})
    return _settings(folder, scene, "surface_scan")

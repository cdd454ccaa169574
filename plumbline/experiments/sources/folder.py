"""A recording folder on disk: `dataset.toml`, `samples.csv` and, where needed, `robot.urdf`.

A folder appears whole or not at all: it is written beside its place under another name and then
renamed. Nothing that is already there is ever overwritten.
"""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd
from numpy.typing import NDArray

from plumbline.experiments.console.places import place
from plumbline.experiments.sources.cache import Source
from plumbline.kinematics.toml_text import document

Scalar: TypeAlias = str | bool | int | float
Value: TypeAlias = Scalar | list[int] | list[float] | list[str] | list[list[int]]


@dataclass(frozen=True)
class Draft:
    """A recording as it will be written."""

    observation: str  # what a row measured, e.g. `tip_position`.
    settings: Mapping[str, Value]  # further top-level keys of `dataset.toml`
    tables: Mapping[str, Mapping[str, Value]]  # its tables by name
    samples: pd.DataFrame  # `samples.csv`, SI units, one row a sample; NaN becomes an empty cell
    urdf: Path | None = None  # file to copy as `robot.urdf`, if any


def tip_draft(robot: str, tool: float, columns: Mapping[str, NDArray[Any]]) -> Draft:
    """Tip readings of a bundled robot whose tool points `tool` [m] along the flange's z."""
    tables: dict[str, dict[str, Value]] = {
        "robot": {"bundled": robot, "tip_frame": "flange"},
        "tool": {"offset": [0.0, 0.0, tool]},
        "fit": {"always": ["frame", "tool"]},
    }
    return Draft("tip_position", {}, tables, pd.DataFrame(columns))


def write(source: Source, draft: Draft, target: Path) -> Path:
    """Write a recording folder, refused where something is, whole or not at all; the target."""
    place(target, lambda folder: _fill(folder, source, draft))
    return target


def _fill(folder: Path, source: Source, draft: Draft) -> None:
    (folder / "dataset.toml").write_text(dataset_toml(source, draft), encoding="utf-8")
    # Twelve digits keep a micrometre in a kilometre, more than any of the instruments gives.
    draft.samples.to_csv(
        folder / "samples.csv", index=False, float_format="%.12g", lineterminator="\n"
    )
    if draft.urdf is not None:
        shutil.copyfile(draft.urdf, folder / "robot.urdf")


def dataset_toml(source: Source, draft: Draft) -> str:
    """Text of `dataset.toml`: provenance, notes, settings, then a table for each group of keys."""
    said: dict[str, Any] = {
        "name": source.name, "observation": draft.observation, "description": source.description,
        "instrument": source.instrument, "source": source.url, "licence": source.licence,
        "citation": source.citation,
    }  # fmt: skip
    hashes = {file.path: file.sha256 for file in source.files}
    notes = "".join(f"# {note}\n" for note in source.notes)
    return notes + document({**said, **draft.settings, **draft.tables, "sha256": hashes})

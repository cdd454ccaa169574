"""The folder: ``dataset.toml``, ``samples.csv``, the robot's file; whole and checked, or none."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from plumbline.errors import PlumblineError
from plumbline.experiments.console.places import place, toml_text
from plumbline.experiments.importing.understood import Understood
from plumbline.experiments.importing.units import UNITS

Found = TypeVar("Found")


def described(target: Path, understood: Understood, asked: Mapping[str, Any]) -> dict[str, Any]:
    """What ``dataset.toml`` says: name, kind, amperes where efforts are read in them, the asked.

    Raises:
        PlumblineError: Some efforts are in amperes, and others are not.
    """
    told = {"name": target.resolve().name, "observation": understood.observation, **asked}
    efforts = [name for name in understood.sources if name.startswith("effort")]
    amperes = [UNITS[understood.sources[e].unit].dimension == "current" for e in efforts]
    if any(amperes):
        if not all(amperes):
            raise PlumblineError(f"{efforts[amperes.index(False)]}: not in A, as others are")
        told["motion"] = {"effort_unit": "A", **asked.get("motion", {})}
    return told


def write(
    understood: Understood,
    settings: Mapping[str, Any],
    files: Mapping[str, Path],
    target: Path,
    accept: Callable[[Path], Found],
) -> Found:
    """Write a recording folder if it can be used.

    Args:
        understood: The rows.
        settings: What ``dataset.toml`` says.
        files: What is copied beside it, by the name that it gets.
        target: The folder; nothing that is there is overwritten.
        accept: Looks at the folder before it is put in its place; raises if it cannot be used.

    Returns:
        What ``accept`` found.

    Raises:
        PlumblineError: The target holds something, cannot be written, or is not accepted.
    """
    found: list[Found] = []

    def fill(folder: Path) -> None:
        (folder / "dataset.toml").write_text(toml_text(settings), encoding="utf-8")
        # Twelve digits keep a micrometre in a kilometre, and a microsecond in a week.
        understood.samples.to_csv(
            folder / "samples.csv", index=False, float_format="%.12g", lineterminator="\n"
        )
        for name, path in files.items():
            shutil.copyfile(path, folder / name)
        found.append(accept(folder))

    place(target, fill)
    return found[0]

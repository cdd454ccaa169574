"""The folder: ``dataset.toml``, ``samples.csv``, the robot's file; whole and checked, or none."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from plumbline.experiments.console.places import place, toml_text
from plumbline.experiments.importing.understood import Understood

Found = TypeVar("Found")


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

"""The folder: ``dataset.toml``, ``samples.csv``, the robot's file; whole and checked, or none."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from plumbline.experiments.console.places import place
from plumbline.experiments.importing.understood import Understood

Found = TypeVar("Found")


def toml_text(settings: Mapping[str, Any]) -> str:
    """Settings as TOML: keys first, then tables, then lists of tables."""
    return "\n".join(_lines(settings, "")) + "\n"


def _lines(settings: Mapping[str, Any], prefix: str) -> Iterator[str]:
    later: list[tuple[str, Any]] = []
    for key, value in settings.items():
        name = key if key.replace("_", "").replace("-", "").isalnum() else json.dumps(key)
        tables = isinstance(value, list) and value and all(isinstance(v, dict) for v in value)
        if isinstance(value, Mapping) or tables:
            later.append((prefix + name, value))
        else:  # JSON's strings, numbers, booleans and lists are TOML's too
            yield f"{name} = {json.dumps(value, ensure_ascii=False)}"
    for name, value in later:
        many = isinstance(value, list)
        for table in value if many else [value]:
            yield from ("", f"[[{name}]]" if many else f"[{name}]")
            yield from _lines(table, f"{name}.")


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

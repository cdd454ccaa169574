"""A recording's folder, made whole or not at all where nothing is yet, and its settings as TOML."""

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from plumbline.errors import PlumblineError


def check_free(target: Path) -> None:
    """Refuse a target that holds anything."""
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise PlumblineError(f"{target} exists and is no folder: move it away, or choose another")
    if target.is_dir() and any(target.iterdir()):
        raise PlumblineError(f"{target} exists and is not empty: move it away, or choose another")


def place(target: Path, fill: Callable[[Path], None]) -> None:
    """Make a folder, whole or not at all, by what fills an empty one beside its place.

    Raises:
        PlumblineError: the target holds something already, or cannot be written.
    """
    check_free(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".plumbline-", dir=target.parent) as scratch:
            made = Path(scratch) / target.name
            made.mkdir()
            fill(made)
            if target.is_dir():
                target.rmdir()
            made.rename(target)
    except OSError as error:
        raise PlumblineError(
            f"{target} cannot be written ({error.strerror}): choose another place"
        ) from error


def toml_text(settings: Mapping[str, Any]) -> str:
    """Settings as TOML: keys first, then tables, then lists of tables."""
    return "\n".join(_lines(settings, "")) + "\n"


def _lines(settings: Mapping[str, Any], prefix: str) -> Iterator[str]:
    later: list[tuple[str, Any]] = []
    for key, value in settings.items():
        plain = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
        name = key if plain else json.dumps(key)
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

"""A recording's folder, made whole or not at all where nothing is yet."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from plumbline.errors import PlumblineError


def check_free(target: Path) -> None:
    """Refuse a target that holds anything."""
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise PlumblineError(f"{target} exists and is no folder: move it away, or choose another")
    if target.is_dir() and any(target.iterdir()):
        raise PlumblineError(f"{target} exists and is not empty: move it away, or choose another")


def place(target: Path, fill: Callable[[Path], None]) -> None:
    """Make a folder where nothing is, whole or not at all, by what fills an empty one."""
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

"""Parquet, and data sets of LeRobot v3: ``data/chunk-*/file-*.parquet`` with ``meta/info.json``.

Lists are taken apart by the names that ``meta/info.json`` gives; an episode is a group.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from plumbline.errors import PlumblineError, fault, one_line
from plumbline.experiments.importing.tables import Raw, expanded
from plumbline.kinematics.files import read_file

EXTRA = 'pip install "plumbline-robotics[parquet]"'
ROLES = {"timestamp": "time", "episode_index": "group"}
LARGEST_INFO = 4_000_000  # [byte]


def read(path: Path) -> list[Raw]:
    """The one table of a Parquet file; names of a LeRobot data set's parts where it is one.

    Raises:
        PlumblineError: It cannot be read, or nothing that reads it is installed.
    """
    info = next((up / "meta" / "info.json" for up in path.resolve().parents[:4]
                 if (up / "meta" / "info.json").is_file()), None)  # fmt: skip
    return [_raw(path.name, _table(path), _names(info))]


def read_dataset(folder: Path) -> list[Raw]:
    """The one table of a LeRobot data set, all of its files one after the other.

    Raises:
        PlumblineError: It has no files, or they cannot be read.
    """
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise fault(f"{folder.name}/data", "no Parquet file", "one or more", "fetch the data set")
    table = pd.concat([_table(file) for file in files], ignore_index=True)
    return [_raw(folder.resolve().name, table, _names(folder / "meta" / "info.json"))]


def _table(path: Path) -> pd.DataFrame:
    try:
        return pd.read_parquet(path, engine="pyarrow")
    except ImportError:
        raise PlumblineError(f"{path.name}: reading Parquet needs pyarrow: {EXTRA}") from None
    except (OSError, ValueError) as error:  # pyarrow's own are of both
        why = one_line(str(error))[:80]
        raise fault(path.name, f"no Parquet ({why})", "Parquet", "export it again") from None


def _raw(name: str, table: pd.DataFrame, names: dict[str, list[str]]) -> Raw:
    columns = {str(c): np.asarray(table[c]) for c in table.columns}
    roles = {c: role for c, role in ROLES.items() if c in columns}
    parts = expanded(columns, names)
    for source, prefix in (("action", "u"), ("observation.state", "q")):
        inside = [c for c in parts if c.startswith(f"{source}.") and source in columns]
        roles |= {c: f"{prefix}{k}" for k, c in enumerate(inside, start=1)}
    return Raw(name, parts, "Parquet", roles=roles)


def _names(info: Path | None) -> dict[str, list[str]]:
    """Names of the parts of every feature; nothing of a file that cannot be read."""
    try:
        content: Any = json.loads(read_file(info, LARGEST_INFO)) if info else {}
        features = content.get("features", {}).items()
        return {str(key): _flat(value.get("names")) for key, value in features}
    except (OSError, ValueError, AttributeError):
        return {}


def _flat(names: Any) -> list[str]:
    """A list of names, or the one that a dictionary such as ``{"motors": [...]}`` holds."""
    if isinstance(names, dict):
        names = next(iter(names.values()), [])
    return [str(name) for name in names] if isinstance(names, list) else []

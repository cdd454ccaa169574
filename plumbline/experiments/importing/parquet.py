"""Parquet, and data sets of LeRobot v2.1 and v3: ``data/chunk-*/*.parquet``, ``meta/info.json``.

Lists are taken apart by the names that ``meta/info.json`` gives; an episode is a group. What has
one name in ``action`` and in ``observation.state`` is a joint, but for grippers and parts of a
pose: the data sets say neither which parts are joints nor in which unit.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from plumbline.errors import PlumblineError, fault, one_line
from plumbline.experiments.importing.tables import Raw, expanded
from plumbline.kinematics.files import read_file

EXTRA = 'pip install "plumbline-robotics[parquet]"'
ROLES = {"timestamp": "time", "episode_index": "group"}
GRIPPER = re.compile(r"gripper|finger", re.IGNORECASE)
POSE = re.compile(r"(^|[._])(r?[xyz]|q[wxyz])($|[._])|^(roll|pitch|yaw)$", re.IGNORECASE)
UNITS = (
    "meta/info.json states no unit: LeRobot's own arms are told in deg (--unit deg) or, where "
    "use_degrees was off, in -100..100 of a joint's range, which no unit turns into an angle"
)
UNNAMED = "meta/info.json has no name for every joint: they are taken in the order of the list"
PICTURES = ("struct", "binary", "large_binary")  # types of Arrow, none of which holds numbers
LARGEST_INFO = 4_000_000  # [byte]


def read(path: Path) -> list[Raw]:
    """The one table of a Parquet file, refused if none; parts named if of a LeRobot data set."""
    info = next((up / "meta" / "info.json" for up in path.resolve().parents[:4]
                 if (up / "meta" / "info.json").is_file()), None)  # fmt: skip
    return [_raw(path.name, _table(path), _info(info))]


def read_dataset(folder: Path) -> list[Raw]:
    """The one table of a LeRobot data set, all of its files in a row (PlumblineError: none)."""
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise fault(f"{folder.name}/data", "no Parquet file", "one or more", "fetch the data set")
    table = pd.concat([_table(file) for file in files], ignore_index=True)
    info = _info(folder / "meta" / "info.json")
    raw, stated = _raw(folder.resolve().name, table, info), info.get("total_frames")
    if isinstance(stated, int) and stated != len(table):
        lacking = f"meta/info.json states {stated:,} frames, {len(table):,} are here"
        raw = replace(raw, notes=(*raw.notes, lacking))
    return [raw]


def _table(path: Path) -> pd.DataFrame:
    try:
        from pyarrow import parquet

        kept = [column.name for column in parquet.read_schema(path)
                if not str(column.type).startswith(PICTURES)]  # fmt: skip
        return pd.read_parquet(path, engine="pyarrow", columns=kept)
    except ImportError:
        raise PlumblineError(f"{path.name}: reading Parquet needs pyarrow: {EXTRA}") from None
    except (OSError, ValueError) as error:  # pyarrow's own are of both
        why = one_line(str(error))[:80]
        raise fault(path.name, f"no Parquet ({why})", "Parquet", "export it again") from None


def _raw(name: str, table: pd.DataFrame, info: Mapping[str, Any]) -> Raw:
    columns = {str(c): np.asarray(table[c]) for c in table.columns}
    names = _names(info)
    roles = {c: role for c, role in ROLES.items() if c in columns} | _joints(columns, names)
    robot = info.get("robot_type")
    told = {UNITS: any(c.endswith(".pos") for c in roles), UNNAMED: "observation.state.1" in roles}
    notes = tuple(note for note, there in told.items() if there)
    return Raw(name, expanded(columns, names), "Parquet", roles=roles, notes=notes,
               robot=robot if isinstance(robot, str) else "")  # fmt: skip


def _joints(columns: Mapping[str, Any], names: Mapping[str, list[str]]) -> dict[str, str]:
    """``u`` and ``q`` of every part that is commanded and measured under one name."""
    both = [(f"action{what}", f"observation.state{what}") for what in (".joint_position", "")]
    pair = next((pair for pair in both if columns.keys() >= set(pair)), ())
    parts = [[c.removeprefix(f"{name}.") for c in expanded({name: columns[name]}, names)]
             for name in pair]  # fmt: skip
    joints = [label for label in (parts[1] if parts else ()) if label in parts[0]
              and not GRIPPER.search(label) and not POSE.search(label)]  # fmt: skip
    return {f"{name}.{label}": f"{role}{k}" for name, role in zip(pair, "uq", strict=False)
            for k, label in enumerate(joints, start=1)}  # fmt: skip


def _info(path: Path | None) -> Mapping[str, Any]:
    """What ``meta/info.json`` says; nothing if there is none (PlumblineError: it says nothing)."""
    if path is None or not path.is_file():
        return {}
    try:
        content: Any = json.loads(read_file(path, LARGEST_INFO))
    except (OSError, ValueError):
        content = None
    if not isinstance(content, dict):
        raise fault("meta/info.json", "no table of JSON", "one", "fetch the data set again")
    return content


def _names(info: Mapping[str, Any]) -> dict[str, list[str]]:
    """Names of the parts of every feature; commands without any have those of the state."""
    features = info.get("features")
    found = features.items() if isinstance(features, dict) else ()
    names = {str(k): _flat(value.get("names")) for k, value in found if isinstance(value, dict)}
    return names | {"action": names.get("action") or names.get("observation.state", [])}


def _flat(names: Any) -> list[str]:
    """A list of names, or the one that ``{"motors": [...]}`` or ``[[...]]`` holds."""
    while names and (isinstance(names, dict) or isinstance(names[0], list)):
        names = next(iter(names.values())) if isinstance(names, dict) else names[0]
        names = names if isinstance(names, dict | list) else []
    return [str(name) for name in names] if isinstance(names, list) else []

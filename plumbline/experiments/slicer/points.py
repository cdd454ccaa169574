r"""Labelled points of 3D Slicer's lists as a table, and as a recording of fiducials.

.. math:: p_{RAS} = \mathrm{diag}(-1, -1, 1)\, p_{LPS}

The table has the columns ``label, x, y, z, description``, one row a point, in m, along the axes
that were asked for.

``.mrk.json`` holds ``markups``, each with a ``type``, a ``coordinateSystem`` (LPS if it says
nothing) and, in later versions, ``coordinateUnits`` (mm if it says nothing); its ``controlPoints``
have a ``label`` and a ``position``. A point whose ``positionStatus`` is not ``defined`` has no
place yet and is left out.

The older ``.fcsv`` has three lines of header, then commas. The header says along which axes, ``#
CoordinateSystem = LPS``; before Slicer 4.11 by a number, 0 for RAS and 1 for LPS. ``# columns =
...`` names the columns. Lengths are in mm.
"""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from plumbline.errors import fault, shown
from plumbline.kinematics.files import read_file, reason
from plumbline.optim.core.problem import Array
from plumbline.optim.registration.fiducials import Fiducials
from plumbline.optim.registration.markers import MarkerNoise

AXES = ("LPS", "RAS")
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}  # of UCUM, as Slicer writes them
FLIP = np.diag([-1.0, -1.0, 1.0])
COLUMNS = ("id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock", "label", "desc",
           "associatedNodeID")  # fmt: skip
NUMBERED = {"0": "RAS", "1": "LPS"}


def check_axes(axes: str, where: str = "axes") -> str:
    """Refuse axes that are neither LPS nor RAS."""
    if axes not in AXES:
        mend = "state the axes that the coordinates are given along"
        raise fault(where, shown(axes), " or ".join(AXES), mend)
    return axes


def axes_changed(points: ArrayLike, source: str, target: str) -> Array:
    """Points (..., 3) given along ``source`` axes, along ``target`` axes: both LPS or RAS."""
    values = np.array(points, dtype=float)
    if check_axes(source) != check_axes(target):
        values = values @ FLIP
    return values


def points_table(
    labels: Sequence[str], points: ArrayLike, descriptions: Sequence[str] | None = None
) -> pd.DataFrame:
    """A table of points (n, 3) [m]."""
    values = np.asarray(points, dtype=float).reshape(-1, 3)
    table = pd.DataFrame(values, columns=list("xyz"))
    table.insert(0, "label", list(labels))
    table["description"] = [""] * len(values) if descriptions is None else list(descriptions)
    return table


def read_text(path: str | Path, kind: str) -> str:
    """A Slicer file's text, refused if it is no UTF-8; ``kind`` is what was expected."""
    file = Path(path).name
    try:
        return read_file(path).decode("utf-8-sig")
    except OSError as error:
        raise fault(file, f"no readable file ({reason(error)})", kind, "mend the path") from None
    except UnicodeDecodeError:
        raise fault(file, "no UTF-8 text", kind, "save it in Slicer again") from None


def read_fcsv(path: str | Path, axes: str = "LPS") -> pd.DataFrame:
    """The points of a ``.fcsv`` in m along the axes asked for, refused if axes or places lack."""
    file = Path(path).name
    check_axes(axes)
    lines = read_text(path, "a .fcsv").splitlines()
    source, names = _header(file, lines)
    rows = [
        (k, next(csv.reader([line])))
        for k, line in enumerate(lines, start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not rows:
        raise fault(file, "no points", "one line a point", "place some in Slicer")
    values = np.array([_place(file, k, row, names) for k, row in rows]) * UNITS["mm"]
    labels = [_cell(row, names, "label") or f"F-{i + 1}" for i, (_, row) in enumerate(rows)]
    words = [_cell(row, names, "desc") for _, row in rows]
    return points_table(labels, axes_changed(values, source, axes), words)


def _header(file: str, lines: list[str]) -> tuple[str, list[str]]:
    said = {}
    for line in lines:
        if line.lstrip().startswith("#") and "=" in line:
            key, _, value = line.lstrip("# ").partition("=")
            said[key.strip().lower()] = value.strip()
    where = f"{file}, CoordinateSystem"
    if "coordinatesystem" not in said:
        mend = "add a line: # CoordinateSystem = LPS"
        raise fault(where, "nothing", "LPS or RAS", mend)
    axes = NUMBERED.get(said["coordinatesystem"], said["coordinatesystem"])
    names = [name.strip() for name in said.get("columns", ",".join(COLUMNS)).split(",")]
    missing = [name for name in "xyz" if name not in names]
    if missing:
        found = f"columns {', '.join(names)}"
        raise fault(f"{file}, columns", found, f"a column {missing[0]!r}", "save it again")
    return check_axes(axes, where), names


def _cell(row: list[str], names: list[str], name: str) -> str:
    k = names.index(name) if name in names else len(row)
    return row[k].strip() if k < len(row) else ""


def _place(file: str, line: int, row: list[str], names: list[str]) -> list[float]:
    cells = [_cell(row, names, name) for name in "xyz"]
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        numbers = [np.nan]
    if not np.isfinite(numbers).all():
        found = shown(",".join(cells))
        raise fault(f"{file}, row {line}", found, "x, y, z in mm", "mend or delete the line")
    return numbers


def read_markups(path: str | Path, axes: str = "LPS") -> pd.DataFrame:
    """The points of a ``.mrk.json``'s lists in m along the axes asked for, else refused."""
    file = Path(path).name
    check_axes(axes)
    lists = _lists(file, Path(path))
    parts = [_points(file, k, content, axes) for k, content in enumerate(lists)]
    table = pd.concat(parts, ignore_index=True)
    if table.empty:
        raise fault(file, "no points with a place", "control points", "place some in Slicer")
    return table


def _lists(file: str, path: Path) -> list[dict[str, Any]]:
    try:
        content = json.loads(read_text(path, "a .mrk.json"))
    except (json.JSONDecodeError, RecursionError) as error:
        found = f"broken JSON ({error})"
        raise fault(file, found, "a .mrk.json", "save it in Slicer again") from None
    lists = content.get("markups") if isinstance(content, dict) else None
    if not isinstance(lists, list) or not lists or not all(isinstance(m, dict) for m in lists):
        mend = "save a point list in Slicer as .mrk.json"
        raise fault(file, "no markups", 'a list "markups"', mend)
    return lists


def _points(file: str, number: int, content: dict[str, Any], axes: str) -> pd.DataFrame:
    where = f"{file}, markups {number}"
    source = check_axes(str(content.get("coordinateSystem", "LPS")), f"{where}, coordinateSystem")
    scale = _unit(where, content.get("coordinateUnits", "mm"))
    given = content.get("controlPoints", [])
    if not isinstance(given, list) or not all(isinstance(p, dict) for p in given):
        mend = "save it in Slicer again"
        raise fault(f"{where}, controlPoints", "no list of points", "points", mend)
    there = [(k, p) for k, p in enumerate(given) if p.get("positionStatus", "defined") == "defined"]
    positions = [_position(f"{where}, point {k}", p.get("position")) for k, p in there]
    values = np.array(positions).reshape(-1, 3) * scale
    labels = [str(p.get("label", "")) or f"F-{k + 1}" for k, p in there]
    words = [str(p.get("description", "")) for _, p in there]
    return points_table(labels, axes_changed(values, source, axes), words)


def _unit(where: str, unit: object) -> float:
    """Metres in one unit; a unit may be a code or a list that begins with it."""
    code = unit[0] if isinstance(unit, list) and unit else unit
    if not isinstance(code, str) or code not in UNITS:
        found, known = shown(unit), ", ".join(UNITS)
        raise fault(f"{where}, coordinateUnits", found, f"one of {known}", "save it in mm")
    return UNITS[code]


def _position(where: str, value: object) -> list[float]:
    numbers = value if isinstance(value, list) else []
    plain = [float(v) for v in numbers if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(plain) != 3 or len(numbers) != 3 or not np.isfinite(plain).all():
        mend = "place the point again, or delete it"
        raise fault(f"{where}, position", shown(value), "three finite numbers", mend)
    return plain


READERS = {".mrk.json": read_markups, ".json": read_markups, ".fcsv": read_fcsv}


def read_points(path: str | Path, axes: str = "LPS") -> pd.DataFrame:
    """Points of a ``.mrk.json`` or ``.fcsv`` [m], else refused: label, x, y, z, description."""
    return READERS[_ending(path)](path, axes)


def _ending(path: str | Path) -> str:
    name = Path(path).name.lower()
    for ending in READERS:
        if name.endswith(ending):
            return ending
    raise fault(Path(path).name, "another kind of file", ".mrk.json or .fcsv", "save it as one")


def to_fiducials(
    ct: pd.DataFrame,
    robot: pd.DataFrame,
    *,
    name: str = "fiducials",
    noise: MarkerNoise | None = None,
) -> Fiducials:
    """A recording, refused if too small, from points in CT and by the robot, matched by labels.

    Columns are label, x, y, z [m]; what the robot did not measure is a target.
    """
    stray = [label for label in robot["label"] if label not in set(ct["label"])]
    if stray:
        known = ", ".join(map(str, ct["label"]))
        raise fault(f"point {stray[0]}", "no such label in CT", f"one of {known}", "rename it")
    both = ct.merge(robot, on="label", how="left", suffixes=("_ct", "_robot"))
    columns = {f"ct_{a}": both[f"{a}_ct"] for a in "xyz"}
    columns |= {f"robot_{a}": both[f"{a}_robot"] for a in "xyz"}
    measured = both[[f"{a}_robot" for a in "xyz"]].notna().all(axis=1)
    role = measured.map({True: "marker", False: "target"})
    table = pd.DataFrame({"label": both["label"], "role": role, **columns})
    return Fiducials.from_table(table, name=name, noise=noise)

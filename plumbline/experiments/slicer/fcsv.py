"""Slicer's older list of points (``.fcsv``): three lines of header, then commas.

The header says along which axes, ``# CoordinateSystem = LPS``; before Slicer 4.11 by a number, 0
for RAS and 1 for LPS. ``# columns = ...`` names the columns. Lengths are in mm.
"""

import csv
from pathlib import Path

import numpy as np
import pandas as pd

from plumbline.errors import shown
from plumbline.experiments.slicer import points

COLUMNS = ("id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock", "label", "desc",
           "associatedNodeID")  # fmt: skip
NUMBERED = {"0": "RAS", "1": "LPS"}


def read_fcsv(path: str | Path, axes: str = "LPS") -> pd.DataFrame:
    """The points of a ``.fcsv``, in m along the axes asked for.

    Raises:
        PlumblineError: The file does not say its axes or columns, or a point has no usable place.
    """
    file = Path(path).name
    points.check_axes(axes)
    lines = points.read_text(path, "a .fcsv").splitlines()
    source, names = _header(file, lines)
    numbered = [(k, line) for k, line in enumerate(lines, start=1) if _is_point(line)]
    rows = [(k, next(csv.reader([line]))) for k, line in numbered]
    if not rows:
        raise points.refusal(file, "no points", "one line a point", "place some in Slicer")
    values = np.array([_place(file, k, row, names) for k, row in rows]) * points.UNITS["mm"]
    labels = [_cell(row, names, "label") or f"F-{i + 1}" for i, (_, row) in enumerate(rows)]
    words = [_cell(row, names, "desc") for _, row in rows]
    return points.points_table(labels, points.axes_changed(values, source, axes), words)


def _is_point(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _header(file: str, lines: list[str]) -> tuple[str, list[str]]:
    said = {}
    for line in lines:
        if line.lstrip().startswith("#") and "=" in line:
            key, _, value = line.lstrip("# ").partition("=")
            said[key.strip().lower()] = value.strip()
    where = f"{file}, CoordinateSystem"
    if "coordinatesystem" not in said:
        mend = "add a line: # CoordinateSystem = LPS"
        raise points.refusal(where, "nothing", "LPS or RAS", mend)
    axes = NUMBERED.get(said["coordinatesystem"], said["coordinatesystem"])
    names = [name.strip() for name in said.get("columns", ",".join(COLUMNS)).split(",")]
    missing = [name for name in "xyz" if name not in names]
    if missing:
        found = f"columns {', '.join(names)}"
        raise points.refusal(f"{file}, columns", found, f"a column {missing[0]!r}", "save it again")
    return points.check_axes(axes, where), names


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
        raise points.refusal(
            f"{file}, row {line}", found, "x, y, z in mm", "mend or delete the line"
        )
    return numbers

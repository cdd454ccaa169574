"""Slicer's markups as JSON (``.mrk.json``): point lists of labelled points.

A file holds ``markups``, each with a ``type``, a ``coordinateSystem`` (LPS if it says nothing),
and, in later versions, ``coordinateUnits`` (mm if it says nothing); its ``controlPoints`` have a
``label`` and a ``position``. A point whose ``positionStatus`` is not ``defined`` has no place yet
and is left out.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from plumbline.errors import shown
from plumbline.experiments.slicer.points import (
    UNITS,
    axes_changed,
    check_axes,
    points_table,
    read_text,
    refusal,
)


def read_markups(path: str | Path, axes: str = "LPS") -> pd.DataFrame:
    """The points of all lists in a ``.mrk.json``, in m along the axes asked for.

    Raises:
        PlumblineError: The file is no markups file, or a point of it has no usable place.
    """
    file = Path(path).name
    check_axes(axes)
    lists = _lists(file, Path(path))
    parts = [_points(file, k, content, axes) for k, content in enumerate(lists)]
    table = pd.concat(parts, ignore_index=True)
    if table.empty:
        raise refusal(file, "no points with a place", "control points", "place some in Slicer")
    return table


def _lists(file: str, path: Path) -> list[dict[str, Any]]:
    try:
        content = json.loads(read_text(path, "a .mrk.json"))
    except (json.JSONDecodeError, RecursionError) as error:
        found = f"broken JSON ({error})"
        raise refusal(file, found, "a .mrk.json", "save it in Slicer again") from None
    lists = content.get("markups") if isinstance(content, dict) else None
    if not isinstance(lists, list) or not lists or not all(isinstance(m, dict) for m in lists):
        mend = "save a point list in Slicer as .mrk.json"
        raise refusal(file, "no markups", 'a list "markups"', mend)
    return lists


def _points(file: str, number: int, content: dict[str, Any], axes: str) -> pd.DataFrame:
    where = f"{file}, markups {number}"
    source = check_axes(str(content.get("coordinateSystem", "LPS")), f"{where}, coordinateSystem")
    scale = _unit(where, content.get("coordinateUnits", "mm"))
    given = content.get("controlPoints", [])
    if not isinstance(given, list) or not all(isinstance(p, dict) for p in given):
        mend = "save it in Slicer again"
        raise refusal(f"{where}, controlPoints", "no list of points", "points", mend)
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
        raise refusal(f"{where}, coordinateUnits", found, f"one of {known}", "save it in mm")
    return UNITS[code]


def _position(where: str, value: object) -> list[float]:
    numbers = value if isinstance(value, list) else []
    plain = [float(v) for v in numbers if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(plain) != 3 or len(numbers) != 3 or not np.isfinite(plain).all():
        mend = "place the point again, or delete it"
        raise refusal(f"{where}, position", shown(value), "three finite numbers", mend)
    return plain

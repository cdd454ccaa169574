"""Tables of named columns, as a file gave them: nothing renamed, nothing converted.

A cell may still be text, since only a column that is used must hold numbers.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from plumbline.errors import PlumblineError, Spot, best_matches, fault, listed, shown
from plumbline.experiments.importing.units import of_header

Array = NDArray[np.float64]
MISSING = frozenset(("", "nan", "na", "n/a", "null", "none", "-", "--"))
TRUTH = {"true": 1.0, "false": 0.0}


@dataclass(frozen=True, eq=False)
class Raw:
    """One table of a file: a CSV, a topic of a bag, the long arrays of a MATLAB file."""

    name: str  # what it is called in ``NAME@COLUMN``: the file's name, or the topic's
    columns: Mapping[str, NDArray[Any]]  # cells (N) by column; numbers or text
    form: str  # how it was read, in words
    # row of the file that holds the first of them, as an editor counts; 1 for what is no text
    first: int = 1
    decimal: str = "."  # mark before the decimals in text
    # units by column, where the file says them
    units: Mapping[str, str] = field(default_factory=dict)
    # what columns are, where the form of the file says it: ``x`` by ``point.x``
    roles: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # what is odd about it but no fault
    robot: str = ""  # what its maker calls the robot, where the file says it

    def __len__(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def numbers(self, column: str, expected: str = "a number") -> Array:
        """A column as numbers (N,), nan of empty cells, refused if one holds anything else."""
        cells = self.columns[column]
        if cells.dtype.kind in "fiub":
            values = cells.astype(float)
            bad = np.isinf(values)
            text = cells
        else:
            text = self._plain(cells)
            lowered = pd.Series(text).str.lower()
            truths = lowered.map(lambda cell: TRUTH.get(cell, cell))
            values = np.asarray(pd.to_numeric(truths, errors="coerce"), dtype=float)
            bad = (np.isnan(values) & ~lowered.isin(MISSING).to_numpy()) | np.isinf(values)
        if bad.any():
            row = int(np.argmax(bad))
            where = Spot.at(self.name, self.first + row, column)
            raise fault(where, shown(str(cells[row])), expected, "mend the cell, or map another")
        return values

    def seconds(self, column: str) -> Array | None:
        """A column of dates as seconds since 1970 (N,); None if it holds numbers."""
        cells = self.columns[column]
        if cells.dtype.kind == "M":
            return np.asarray(cells.astype("datetime64[ns]").astype(np.int64) * 1e-9, dtype=float)
        if cells.dtype.kind in "fiub" or is_number(self._plain(cells[:1])[0]):
            return None
        moments = pd.to_datetime(pd.Series(cells), errors="coerce", utc=True, format="ISO8601")
        if moments.isna().any():
            return None
        return np.asarray((moments - pd.Timestamp(0, tz="UTC")).dt.total_seconds(), dtype=float)

    def _plain(self, cells: NDArray[Any]) -> NDArray[Any]:
        """Text with a decimal point and an ASCII minus."""
        text = pd.Series(cells).astype(str).str.strip().str.replace("\N{MINUS SIGN}", "-")
        if self.decimal == ",":
            text = text.where(text.str.contains(".", regex=False), text.str.replace(",", "."))
        return np.asarray(text, dtype=object)


def is_number(cell: str) -> bool:
    """Whether a cell is a number as Python writes it."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def expanded(columns: Mapping[str, NDArray[Any]], names: Mapping[str, list[str]]) -> dict[str, Any]:
    """Columns of lists taken apart: ``state`` becomes ``state.shoulder`` or ``state.1``.

    Args:
        columns: Cells by column.
        names: Names of a column's parts, where they are known.
    """
    found: dict[str, Any] = {}
    for name, cells in columns.items():
        parts = _parts(cells)
        if parts is None:
            found[name] = cells
            continue
        known = names.get(name, [])
        labels = known if len(known) == parts.shape[1] else range(1, parts.shape[1] + 1)
        found |= {f"{name}.{label}": parts[:, k] for k, label in enumerate(labels)}
    return found


def _parts(cells: NDArray[Any]) -> Array | None:
    """Lists of one length in each cell, as (N, k); None if there are none."""
    if cells.dtype != object or not len(cells) or np.ndim(cells[0]) != 1:
        return None
    try:
        parts = np.array([np.asarray(cell, dtype=float) for cell in cells])
    except (TypeError, ValueError):
        return None
    return parts if parts.ndim == 2 else None


def find(raws: list[Raw], source: str) -> tuple[Raw, str]:
    """The table and column that ``COLUMN`` or ``TABLE@COLUMN`` names (PlumblineError: not one)."""
    table, at, column = source.rpartition("@")
    chosen = [raw for raw in raws if not at or table in (raw.name, Path(raw.name).stem)]
    if not chosen:
        there = listed(raw.name for raw in raws)
        raise fault(f"--map {source}", f"no table {shown(table)}", f"one of {there}", "mend it")
    having = [(raw, column) for raw in chosen if column in raw.columns]
    # Or as it is called before its unit: X of "X [mm]".
    having = having or [
        (raw, name) for raw in chosen for name in raw.columns if of_header(name)[0] == column
    ]
    if len(having) == 1:
        return having[0]
    if having:
        names = listed(f"{raw.name}@{name}" for raw, name in having)
        raise fault(f"--map {source}", f"{len(having)} such columns", "one", f"write {names}")
    every = [name for raw in chosen for name in raw.columns]
    raise PlumblineError(
        f"--map {source}: no such column among {len(every)}; nearest: {best_matches(column, every)}"
    )


def told_apart(raws: list[Raw]) -> list[Raw]:
    """Tables whose names differ, else refused: a column of either could not be named."""
    seen: set[str] = set()
    for raw in raws:
        if raw.name in seen:
            raise PlumblineError(
                f"{raw.name}: two tables of that name, expected one; rename a file"
            )
        seen.add(raw.name)
    return raws

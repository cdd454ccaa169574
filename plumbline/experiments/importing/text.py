"""CSV as it comes: any separator; decimal points or commas; remarks above the header.

What stands between cells is the mark that cuts the first lines into the same number of cells, more
than one, at last any number of spaces; a decimal comma is told by cells such as ``3,14``, which are
quoted where commas separate.
"""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from plumbline.errors import fault
from plumbline.experiments.importing import units
from plumbline.experiments.importing.tables import Raw, expanded, is_number
from plumbline.kinematics.files import read_file, reason
from plumbline.optim.recording.table import cut_short

LARGEST_TEXT = 1_000_000_000  # [byte]: an hour of 50 columns at 1 kHz
MARKS = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars", " ": "spaces"}
LOOKED_AT = 20  # lines below the header that must be cut alike
DECIMALS = re.compile(r"^[-+\N{MINUS SIGN}]?\d*,\d+([eE][-+]?\d+)?$")
GROUPED = re.compile(r",\d{3}$")  # thousands, it may be
REMARK = ("#", "%", "//")


def read(path: Path) -> list[Raw]:
    """The one table of a CSV file (PlumblineError: it has no rows of equal length, ...)."""
    text = _decoded(path)
    lines = text.splitlines(keepends=True)
    skipped = _head(lines)
    body = lines[skipped:]
    if len(body) < 2:
        raise fault(path.name, "no rows below the header", "samples", "record some samples")
    mark = _mark(body)
    table = _cells(path, "".join(body), mark, skipped)
    notes = cut_short(path.name, text, len(lines), [*map(str, table.iloc[1:, -1])])
    header, table, first = _header(table, skipped, _remarked(lines[:skipped], mark))
    said = _units_row(table)
    if said:
        table, first = table.iloc[1:], first + 1
    columns = {name: _column(table.iloc[:, k]) for k, name in enumerate(header) if name}
    some = table.iloc[: 10 * LOOKED_AT].to_numpy().ravel()
    comma = _decimal_commas([str(cell).strip() for cell in some], mark)
    raw = expanded(columns, {})
    form = f"{MARKS[mark]} between cells" + (", decimal commas" if comma else "")
    given = {name: said[k] for k, name in enumerate(header) if said and said[k]}
    return [Raw(path.name, raw, form, first, "," if comma else ".", given, notes=notes)]


def _decimal_commas(cells: list[str], mark: str) -> bool:
    """Whether cells such as ``3,14`` are numbers.

    Where commas separate, such a cell was quoted, and a comma before three digits may group them.
    """
    told = [cell for cell in cells if DECIMALS.match(cell)]
    if mark != ",":
        return bool(told)
    return any(not GROUPED.search(cell) for cell in told) and not any("." in cell for cell in cells)


def _decoded(path: Path) -> str:
    try:
        data = read_file(path, LARGEST_TEXT)
    except (OSError, ValueError) as error:
        raise fault(path.name, reason(error), "a readable file", "mend it") from None
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", "replace")
    if b"\0" in data:
        raise fault(path.name, "a zero byte", "text", "it is binary: export text")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:  # what a Western European Windows writes; each byte has a meaning
        return data.decode("latin-1")


def _head(lines: list[str]) -> int:
    """How many lines are remarks, empty, or a spreadsheet's ``sep=;``."""
    for number, line in enumerate(lines):
        plain = line.strip()
        if plain and not plain.startswith(REMARK) and not plain.lower().startswith("sep="):
            return number
    return len(lines)


def _mark(body: list[str]) -> str:
    """What stands between cells; a comma if nothing does."""
    some = body[: LOOKED_AT + 1]
    plain = [" ".join(line.split()) for line in some]
    texts = {mark: plain if mark == " " else some for mark in MARKS}
    cuts = {m: [len(row) for row in csv.reader(t, delimiter=m) if row] for m, t in texts.items()}
    alike = [mark for mark, counts in cuts.items() if counts[0] > 1 and len(set(counts)) == 1]
    loose = [mark for mark, counts in cuts.items() if counts[0] > 1 and mark != " "]
    return next(iter(alike or loose), ",")


def _cells(path: Path, text: str, mark: str, skipped: int) -> pd.DataFrame:
    separator = r"\s+" if mark == " " else mark
    try:
        table = pd.read_csv(
            io.StringIO(text), sep=separator, header=None, dtype=str, keep_default_na=False,
            skipinitialspace=True, skip_blank_lines=False,
        )  # fmt: skip
    except (pd.errors.ParserError, pd.errors.EmptyDataError, csv.Error, ValueError) as error:
        line = re.search(r"line (\d+)", str(error))
        where = f"{path.name}, row {int(line[1]) + skipped}" if line else path.name
        why = str(error).split("\n")[0].removeprefix("Error tokenizing data. C error: ")
        if cells := re.fullmatch(r"Expected (\d+) fields in line \d+, saw (\d+)", why.strip()):
            expected = f"{cells[1]} as in the first row"
            raise fault(where, f"{cells[2]} cells", expected, "mend the row") from None
        raise fault(where, why[:80], "as many cells as in the first row", "mend the row") from None
    return table.fillna("")


def _remarked(above: list[str], mark: str) -> list[str]:
    """Cells of the last remark above the rows: NumPy's ``# x,y``, a ROS echo's ``%time,x``."""
    last = above[-1].strip() if above else ""
    sign = next((sign for sign in REMARK if last.startswith(sign)), None)
    if sign is None:
        return []
    line = last[len(sign) :].strip()
    return line.split() if mark == " " else next(csv.reader([line], delimiter=mark), [])


def _header(
    table: pd.DataFrame, skipped: int, remarked: list[str]
) -> tuple[list[str], pd.DataFrame, int]:
    """Column names, the rows below them, and the first one's number in the file."""
    names = [str(name).strip() for name in table.iloc[0]]
    below = 1
    if all(_numeric(name) for name in names):
        names, below = [name.strip() for name in remarked], 0
        if len(names) != table.shape[1] or any(_numeric(name) for name in names):
            return [str(k + 1) for k in range(table.shape[1])], table, skipped + 1
    seen: dict[str, int] = {}
    for k, name in enumerate(names):
        seen[name] = seen.get(name, 0) + 1
        names[k] = f"{name}.{seen[name]}" if seen[name] > 1 and name else name
    return names, table.iloc[below:], skipped + 1 + below


def _units_row(table: pd.DataFrame) -> list[str]:
    """The row below the header, if it says units and nothing else."""
    cells = [str(cell).strip().strip("[]()") for cell in table.iloc[0]] if len(table) else []
    worded = [cell for cell in cells if cell and not _numeric(cell)]
    holds = bool(worded) and all(not cell or units.known(cell) is not None for cell in cells)
    return cells if holds and len(worded) == len([cell for cell in cells if cell]) else []


def _column(cells: pd.Series[str]) -> NDArray[Any]:
    values = np.asarray(cells, dtype=object)
    if len(values) and str(values[0]).startswith("["):
        try:
            lists = [json.loads(str(cell)) for cell in values]
        except ValueError:
            return values
        taken = np.empty(len(lists), dtype=object)
        taken[:] = lists
        return taken
    return values


def _numeric(cell: str) -> bool:
    return is_number(cell.replace(",", "."))

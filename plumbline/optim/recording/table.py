"""A CSV file of numbers, read strictly: what is no number is named by row and column.

Rows count as an editor counts lines, the header being row 1. Blank lines, a byte order mark and
either kind of line end are no fault; everything that would have to be guessed at is.

Where rows and settings came from: what is found wrong with them later still names the place.
"""

import csv
import io
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from plumbline.errors import (
    MOST_LISTED,
    PlumblineError,
    Spot,
    best_matches,
    did_you_mean,
    fault,
    listed,
    shown,
)
from plumbline.kinematics.evaluate import Array as Array
from plumbline.kinematics.evaluate import Flags as Flags
from plumbline.kinematics.evaluate import Indices as Indices
from plumbline.kinematics.evaluate import Integers as Integers
from plumbline.optim.recording.constants import FIRST_ROW, LARGEST, MOST_COLUMNS, MOST_ROWS

HEADER = "the header being row 1"


def row_numbers(chosen: Flags) -> tuple[int, ...]:
    """Numbers of the rows that a mask (N,) picks, as an editor counts: the header is row 1."""
    return tuple((FIRST_ROW + np.flatnonzero(chosen)).tolist())


@dataclass(frozen=True)
class Origin:
    """Where rows came from, so that a fault found late can still name the place."""

    file: str = "arrays"  # name of the file, or ``"arrays"``
    # line number (N,) of each row in the file; None for arrays, counted from 0
    lines: Integers | None = None
    # where each setting stands, by its name: ``{"noise_std": "dataset.toml, row 3, ..."}``
    keys: Mapping[str, str] = field(default_factory=dict)
    # what columns that are counted otherwise within are called in the file: ``{"q4": "q3"}``
    columns: Mapping[str, str] = field(default_factory=dict)

    def column(self, name: str) -> str:
        """What the file calls a column."""
        return self.columns.get(name, name)

    def key(self, name: str) -> str:
        """Where a setting stands, or just its name."""
        return self.keys.get(name, name)

    def at(self, column: str, index: int | np.integer | None = None) -> Spot:
        """``samples.csv, row 17, column 'q3'`` for the row of that index."""
        column = self.column(column)
        if index is None:
            return Spot.at(self.file, None, column)
        if self.lines is None:
            words = f"{self.file}, row {int(index)} (from 0), column {shown(column)}"
            return Spot(words, self.file, int(index), column)
        return Spot.at(self.file, int(self.lines[index]), column)

    def refuse(self, column: str, bad: Flags, values: Array | Integers, *words: str) -> None:
        """Refuse the first row that is bad (N,): what is expected of its value, and the way out."""
        if bad.any():
            row = int(np.argmax(bad))
            raise fault(self.at(column, row), shown(values[row].item()), *words)


@dataclass(frozen=True)
class Table:
    """Named columns of text, N rows each, and where each row came from."""

    origin: Origin  # the file and the line of every row
    columns: Mapping[str, Sequence[str]]  # cells (N) by column name
    notes: tuple[str, ...] = ()  # what is odd about the file but no fault

    def __len__(self) -> int:
        return 0 if self.origin.lines is None else len(self.origin.lines)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def require(self, names: Iterable[str]) -> None:
        """Check that the columns are there (PlumblineError: the first column that is not)."""
        for name in names:
            if name not in self.columns:
                raise self._missing(name)

    def numbers(self, name: str) -> Array:
        """A column as finite numbers (N,), refused if it is missing or holds others."""
        self.require([name])
        cells = self.columns[name]
        if plain(cells):
            try:
                values = np.array([float(cell) for cell in cells])
            except ValueError:
                values = np.array([math.nan])
            if np.all(np.abs(values) <= LARGEST):
                return values
        raise self._culprit(name)

    def block(self, names: Sequence[str]) -> Array:
        """Several columns as finite numbers (N, k)."""
        columns = [self.numbers(name) for name in names]
        return np.column_stack(columns) if columns else np.empty((len(self), 0))

    def unused(self, used: Iterable[str]) -> tuple[str, ...]:
        """A note for each of the first columns that nothing reads, and one for the rest."""
        known = dict.fromkeys(used)
        extra = [name for name in self.columns if name and name not in known]
        file, few = self.origin.file, extra[:MOST_LISTED]
        notes = [f"{file}: column {shown(n)} is not used{did_you_mean(n, known)}" for n in few]
        if len(extra) > MOST_LISTED:
            notes.append(f"{file}: ... and {len(extra) - MOST_LISTED:,} more columns are not used")
        return tuple(notes)

    def _missing(self, name: str) -> PlumblineError:
        header = [column for column in self.columns if column]
        near = best_matches(name, header)
        return fault(
            f"{self.origin.file}, row 1, column {name!r}",
            f"no such column among {len(header)} ({listed(header)})",
            f"a column {name!r}",
            f"add it, or rename one (nearest: {near})",
        )

    def _culprit(self, name: str) -> PlumblineError:
        """The first cell of a column that is no finite number, with its reason."""
        cells = self.columns[name]
        index = next(i for i, cell in enumerate(cells) if not is_number(cell))
        empty = all(not cell.strip() for cell in cells)
        found, expected, mend = diagnose_cell(cells[index])
        if empty:
            found, mend = "an empty column", "fill it or delete the column"
        return fault(self.origin.at(name, index), found, expected, mend)


def plain(cells: Sequence[str]) -> bool:
    """Whether float() reads the cells as other programs do: no ``1_000``, no other digits."""
    text = "".join(cells)
    return text.isascii() and "_" not in text


def is_number(cell: str) -> bool:
    """Whether a cell is a finite number of a believable size."""
    try:
        return plain([cell]) and abs(float(cell)) <= LARGEST
    except ValueError:
        return False


def diagnose_cell(cell: str) -> tuple[str, str, str]:
    """What is wrong with a cell that is no number: found, expected, way out."""
    text = cell.strip()
    if not text:
        return "an empty cell", "a number", "fill it in or delete the row"
    if text.lower() in ("true", "false"):
        return shown(text), "a number", "write 1 for true and 0 for false"
    comma = "," in text and text.replace(".", "").replace(",", ".", 1)
    if comma and is_number(comma):
        return shown(text), "a number with a decimal point", "replace decimal commas by points"
    if is_number(text.replace("\N{MINUS SIGN}", "-")):
        return shown(text), "an ASCII minus sign", "replace the typographic minus by '-'"
    if not plain([text]):
        return shown(text), "a number in plain digits", "mend the cell or delete the row"
    try:
        size = abs(float(text))
    except ValueError:
        return shown(text), "a number", "mend the cell or delete the row"
    if math.isfinite(size):
        return shown(text), f"a number below {LARGEST:g} in SI units", "mend the cell or its unit"
    return shown(text), "a finite number", "mend the cell or delete the row"


def decode(file: str, data: bytes) -> str:
    """The text of a UTF-8 file, refused if empty, binary or in another encoding."""
    if not data.strip():
        raise fault(file, "an empty file", "text", "write the file again")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise fault(f"{file}, row 1", "UTF-16 text", "UTF-8 text", "save the file as UTF-8")
    if b"\0" in data:
        row = data[: data.index(b"\0")].count(b"\n") + 1
        raise fault(Spot.at(file, row), "a zero byte", "UTF-8 text", "it is binary: export text")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = data[: error.start].count(b"\n") + 1
        byte = f"byte 0x{data[error.start]:02x}"
        raise fault(Spot.at(file, row), byte, "UTF-8 text", "save the file as UTF-8") from None


def read_table(file: str, data: bytes) -> Table:
    """The columns of a CSV file, given its bytes (PlumblineError: a row or a name is off)."""
    text = decode(file, data)
    rows, lines = _split(file, text)
    header = [name.strip() for name in rows[0]] if rows else []
    _check_header(file, header)
    if len(rows) == 1:
        raise fault(f"{file}, row 2", "no rows below the header", "samples", "record some samples")
    _check_lengths(file, header, rows, lines)
    columns = dict(zip(header, zip(*rows[1:], strict=True), strict=True))
    notes = cut_short(file, text, int(lines[-1]), [row[-1] for row in rows[1:]])
    return Table(Origin(file, np.array(lines[1:], dtype=np.int64)), columns, notes)


def cut_short(file: str, text: str, row: int, column: Sequence[str]) -> tuple[str, ...]:
    """A note on a last row without a line end; refused if its last cell is surely half a number."""
    if text.endswith(("\n", "\r")) or not column:
        return ()
    *others, cell = (cell.strip() for cell in column)
    numbers = [other for other in others if any(c.isdigit() for c in other)]
    least = min(map(_decimals, numbers), default=0)
    if _decimals(cell) < least:
        found = f"{shown(cell)} and no line end, where every other row has {least} decimals or more"
        mend = "delete the row, or end the line if it is whole"
        raise fault(Spot.at(file, row), found, "a whole number", mend)
    within = f" within {shown(cell)}" if cell else ""
    return (f"{Spot.at(file, row)}: no line end; was it cut short{within}?",)


def _decimals(cell: str) -> int:
    """Characters after the decimal mark, an exponent among them."""
    _, mark, after = cell.replace(",", ".").partition(".")
    return len(after) if mark else 0


def _split(file: str, text: str) -> tuple[list[list[str]], list[int]]:
    """Rows of cells and their line numbers; blank lines are left out."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    rows, lines = [], []
    try:
        for row in reader:
            if len(row) > 1 or "".join(row).strip():
                rows.append(row)
                lines.append(reader.line_num)
            if len(rows) > MOST_ROWS + 1:
                mend = "keep every tenth, or cut the recording into several"
                raise fault(file, f"more than {MOST_ROWS:,} rows", "fewer", mend)
    except csv.Error as error:
        where = Spot.at(file, reader.line_num)
        if "field limit" in str(error):
            found = f"a cell of more than {csv.field_size_limit()} characters"
            mend = "mend the row: is the closing quote or the line end missing?"
            raise fault(where, found, "a number", mend) from None
        raise fault(where, f"broken CSV ({error})", "plain cells", "mend the quotes") from None
    return rows, lines


def _check_header(file: str, header: list[str]) -> None:
    where = f"{file}, row 1"
    if len(header) > MOST_COLUMNS:
        mend = "leave out what a recording does not need"
        raise fault(where, f"{len(header):,} columns", f"at most {MOST_COLUMNS:,}", mend)
    if not any(header):
        raise fault(where, "no column names", "a header", "name the columns in the first line")
    if header[0].startswith("#"):
        raise fault(where, f"a comment ({shown(header[0])})", "column names", "delete that line")
    if len(header) == 1:
        for mark, name in ((";", "semicolons"), ("\t", "tabs")):
            if mark in header[0]:
                mend = "replace decimal commas by points, then the separators by commas; or let "
                mend += "plumbline import read the file"
                raise fault(where, f"columns separated by {name}", "commas", mend)
    if all(is_number(name) for name in header):
        raise fault(where, "numbers", "column names", "put a header line on top")
    doubled = [name for name, count in Counter(header).items() if count > 1 and name]
    if doubled:
        found = f"{header.count(doubled[0])} columns of that name"
        where = f"{where}, column {shown(doubled[0])}"
        raise fault(where, found, "one", "rename or delete the other")


def _check_lengths(file: str, header: list[str], rows: list[list[str]], lines: list[int]) -> None:
    width = len(header)
    ragged = next((i for i, row in enumerate(rows) if len(row) != width), None)
    if ragged is None:
        return
    found, last = len(rows[ragged]), ragged == len(rows) - 1
    if found > width and not rows[ragged][-1].strip():
        mend = "delete the comma at the end of the row"
    elif found > width:
        mend = "replace decimal commas by points, or mend the row"
    else:
        mend = "the file was cut short: delete its last line" if last else "mend or delete the row"
    column = header[min(found, width - 1)]
    where = Spot.at(file, int(lines[ragged]), column)
    raise fault(where, f"{found} cells", f"{width} as in the header", mend)


def as_integers(values: Array, column: str, origin: Origin) -> Integers:
    """Whole numbers (N,) of a column of numbers (N,), refused if not whole."""
    bad = values != np.round(values)
    origin.refuse(column, bad, values, "a whole number", "number them 0, 1, 2, ...")
    return values.astype(np.int64)

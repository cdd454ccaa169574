"""One class of errors: one line says where, what was found, what was expected, the way out.

``samples.csv, row 17, column 'q3': found 'abc', expected a number; mend or delete the row``
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST_SHOWN = 48  # characters of a found value that a message repeats
MOST_LISTED = 8  # names that a message lists before it says how many more there are


class PlumblineError(ValueError):
    """What a user or the data did that cannot be answered; the message is one line.

    Attributes:
        file: The file that it stands in, if any.
        row: Its row there, as an editor counts.
        column: The column, or the key of a setting.
        value: What was found, as the message repeats it.
        limit: What was expected.
        remedy: The way out.
    """

    def __init__(
        self,
        message: str,
        *,
        file: str | None = None,
        row: int | None = None,
        column: str | None = None,
        value: str | None = None,
        limit: str | None = None,
        remedy: str | None = None,
    ) -> None:
        super().__init__(message)
        self.file, self.row, self.column = file, row, column
        self.value, self.limit, self.remedy = value, limit, remedy

    def inside(self, folder: str) -> PlumblineError:
        """The same of a file in one folder of several, which it then names."""
        file = str(self).partition(":")[0].partition(",")[0]
        if self.file != file and not file.endswith((".toml", ".csv")):
            return self
        rest = {k: getattr(self, k) for k in ("row", "column", "value", "limit", "remedy")}
        return PlumblineError(f"{folder}/{self}", file=f"{folder}/{file}", **rest)


class Spot(str):
    """Where something stands, in words that a message starts with, and in parts."""

    __slots__ = ("column", "file", "row")

    file: str | None
    row: int | None
    column: str | None

    def __new__(
        cls, words: str, file: str | None = None, row: int | None = None, column: str | None = None
    ) -> Spot:
        """Words, and what they are made of."""
        spot = super().__new__(cls, words)
        spot.file, spot.row, spot.column = file, row, column
        return spot

    @classmethod
    def at(cls, file: str, row: int | None = None, column: str | None = None) -> Spot:
        """``samples.csv, row 17, column 'q3'``; what is None is left out."""
        words = [file]
        words += [f"row {row}"] if row is not None else []
        words += [f"column {shown(column)}"] if column is not None else []
        return cls(", ".join(words), file, row, column)


def one_line(text: str) -> str:
    """The same words on one printable line."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))


def shown(value: object) -> str:
    """A found value as a message repeats it: quoted, printable, cut if long."""
    text = f"{value:.9g}" if isinstance(value, float) else ascii(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def listed(names: Iterable[object], most: int = MOST_LISTED) -> str:
    """Names as a message lists them: the first few, each cut if long, and how many more."""
    every = [str(name) for name in names]
    few = [n if len(n) <= LONGEST_SHOWN else f"{n[:LONGEST_SHOWN]}..." for n in every[:most]]
    more = f" ... and {len(every) - most:,} more" if len(every) > most else ""
    return f"{', '.join(few)}{more}"


def fault(where: str, found: str, expected: str, mend: str) -> PlumblineError:
    """The error to raise: where it is, what is there, what should be, and how to mend it."""
    spot = where if isinstance(where, Spot) else Spot(where)
    return PlumblineError(
        one_line(f"{where}: found {found}, expected {expected}; {mend}"),
        file=spot.file,
        row=spot.row,
        column=spot.column,
        value=found,
        limit=expected,
        remedy=mend,
    )


def best_matches(name: str, known: Iterable[str], limit: int = 3) -> str:
    """The known names nearest to ``name``, upper and lower case alike; the first if none is."""
    by_lower = _comparable(known)
    near = _near(name, by_lower, limit, 0.4)
    return listed([by_lower[word] for word in near] or by_lower.values())


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`` (did you mean 'x'?)`` if a known name is very near, else nothing."""
    by_lower = _comparable(known)
    near = _near(name, by_lower, 1, 0.75)
    return f" (did you mean {by_lower[near[0]]!r}?)" if near else ""


def _comparable(known: Iterable[str]) -> dict[str, str]:
    """Names by their lower case; comparing takes the product of two lengths: no long ones."""
    return {word.lower(): word for word in known if len(word) <= LONGEST_SHOWN}


def _near(name: str, by_lower: Iterable[str], limit: int, cutoff: float) -> list[str]:
    return difflib.get_close_matches(name.lower()[:LONGEST_SHOWN], by_lower, limit, cutoff)

"""Faults of a recording: one line says where, what was found, what was expected, the way out.

``samples.csv, row 17, column 'q3': found 'abc', expected a number; mend or delete the row``
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

LONGEST_SHOWN = 48  # characters of a found value that a message repeats
MOST_LISTED = 8  # names that a message lists before it says how many more there are


class RecordingError(ValueError):
    """A recording that cannot be used; the message is one line."""


class RegistrationError(RecordingError):
    """Points or markers that fix no frame; the message is one line with the way out."""


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


def fault(where: str, found: str, expected: str, mend: str) -> RecordingError:
    """The error to raise: where it is, what is there, what should be, and how to mend it."""
    return RecordingError(one_line(f"{where}: found {found}, expected {expected}; {mend}"))


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


@dataclass(frozen=True)
class Origin:
    """Where rows came from, so that a fault found late can still name the place.

    Attributes:
        file: Name of the file, or ``"arrays"``.
        lines: Line number (N,) of each row in the file; None for arrays, counted from 0.
        keys: Where each setting stands, by its name: ``{"noise_std": "dataset.toml, row 3, ..."}``.
    """

    file: str = "arrays"
    lines: Integers | None = None
    keys: Mapping[str, str] = field(default_factory=dict)

    def key(self, name: str) -> str:
        """Where a setting stands, or just its name."""
        return self.keys.get(name, name)

    def at(self, column: str, index: int | np.integer | None = None) -> str:
        """``samples.csv, row 17, column 'q3'`` for the row of that index."""
        if index is None:
            return f"{self.file}, column {column!r}"
        if self.lines is None:
            return f"{self.file}, row {int(index)} (from 0), column {column!r}"
        return f"{self.file}, row {int(self.lines[index])}, column {column!r}"

"""A TOML file read strictly: a key of the wrong type, length or size is named with its row."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError, Spot, best_matches, did_you_mean, fault, shown
from plumbline.kinematics.files import read_file, reason
from plumbline.optim.recording import constants
from plumbline.optim.recording.table import Array, decode

PARTED = re.compile(r"[=,\[\]{}]")
UNITS = ("N m", "A")  # of efforts
QUOTED = re.compile(r"\"[^\"\n]*\"|'[^'\n]*'")


@dataclass(frozen=True)
class Section:
    """One table of a TOML file."""

    file: str  # name of the file
    text: str  # all of its text, in which rows are looked up
    values: Mapping[str, object]  # keys and values of this table
    title: str = ""  # ``"robot"`` for ``[robot]``, empty for the top

    def where(self, key: str) -> Spot:
        """``dataset.toml, row 7, [robot] tip_frame``."""
        row = _row_of(self.text, self.title, key)
        title = f"[{self.title}] " if self.title else ""
        words = f"{self.file}, {f'row {row}, ' if row else ''}{title}{key}"
        return Spot(words, self.file, row or None, key)

    def fault(self, key: str, expected: str, mend: str) -> PlumblineError:
        """The error for the value of a key."""
        found = shown(self.values[key]) if key in self.values else "nothing"
        return fault(self.where(key), found, expected, mend)

    def section(self, key: str) -> Section:
        """A table inside of this one; an absent one is empty."""
        values = self.values.get(key, {})
        if not isinstance(values, dict):
            raise self.fault(key, f"a table [{key}]", f"write [{key}] on a line of its own")
        return Section(self.file, self.text, values, key)

    def word(self, key: str) -> str | None:
        """A string that is not empty, or None if the key is absent."""
        return self._checked(key, _is_word, "a word in quotes", f'write {key} = "..."')

    def number(self, key: str) -> float | None:
        """A finite number, or None if the key is absent."""
        mend = f"write {key} = 1.0, without quotes"
        value = self._checked(key, _finite, "a finite number", mend)
        return None if value is None else float(str(value))

    def vector(self, key: str) -> Array | None:
        """Three finite numbers, or None if the key is absent."""
        mend = f"write {key} = [0.0, 0.0, 0.0]"
        value = self._checked(key, _is_place, "three finite numbers", mend)
        return None if value is None else np.array(value, dtype=float)

    def words(self, key: str) -> tuple[str, ...] | None:
        """Strings, or None if the key is absent."""
        mend = f'write {key} = ["...", "..."]'
        value = self._checked(key, _all(str), "a list of words", mend)
        return None if value is None else tuple(value)

    def integers(self, key: str) -> tuple[int, ...] | None:
        """Whole numbers, or None if the key is absent."""
        mend = f"write {key} = [1, 2]"
        value = self._checked(key, _all(int), "a list of whole numbers", mend)
        return None if value is None else tuple(value)

    def _checked(self, key: str, good: Callable[[Any], bool], expected: str, mend: str) -> Any:
        value = self.values.get(key)
        if value is not None and not good(value):
            raise self.fault(key, expected, mend)
        return value

    def unused(self, known: Iterable[str]) -> tuple[str, ...]:
        """A note for every key that nothing reads."""
        known = list(known)
        extra = [key for key in self.values if key not in known]
        return tuple(f"{self.where(key)}: not used{did_you_mean(key, known)}" for key in extra)

    def refuse_unknown(self, known: Sequence[str]) -> None:
        """Refuse a key that nothing reads, where nothing may be left out unseen."""
        for key in [key for key in self.values if key not in known]:
            mend = f"best matches: {best_matches(key, known)}"
            raise fault(self.where(key), f"the key {shown(key)}", ", ".join(known), mend)


def read_settings_file(path: Path, largest: int = constants.LARGEST_SETTINGS) -> Section:
    """The settings of a TOML file (PlumblineError: it cannot be read, or is none)."""
    try:
        data = read_file(path, largest)
    except (OSError, ValueError) as error:
        found = f"a file that cannot be read ({reason(error)})"
        raise fault(str(path), found, "a TOML file", "check the path") from None
    return read_settings(path.name, data)


def read_settings(file: str, data: bytes) -> Section:
    """The top table of a TOML file, given its bytes; refused if it is none."""
    text = decode(file, data)
    _refuse_long_keys(file, text)
    try:
        return Section(file, text, tomllib.loads(text))
    except RecursionError:
        raise fault(file, "tables nested too deep", "TOML", "write it plainly") from None
    except ValueError as error:  # TOMLDecodeError, and what int() and datetime refuse
        line = re.search(r"at line (\d+)", str(error))
        where = Spot.at(file, int(line[1]) if line else text.count(chr(10)) + 1)
        found = f"broken TOML ({str(error)[: constants.LONGEST_REASON]})"
        raise fault(where, found, "key = value", "mend that line") from None


def _refuse_long_keys(file: str, text: str) -> None:
    for row, line in enumerate(text.split("\n"), start=1):
        if line.count(".") < constants.MOST_PARTS:
            continue
        bare = QUOTED.sub("", line).partition("#")[0]
        parts = 1 + max(word.count(".") for word in PARTED.split(bare))
        if parts > constants.MOST_PARTS:
            found, mend = f"a key of {parts:,} parts", "write tables plainly"
            raise fault(Spot.at(file, row), found, f"at most {constants.MOST_PARTS}", mend)


def _finite(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    # Compared before any conversion: a TOML integer may be too large for a float.
    return -constants.LARGEST <= value <= constants.LARGEST and math.isfinite(value)


def _is_word(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip())


def _is_place(value: object) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(_finite, value))


def _all(kind: type) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and all(type(one) is kind for one in value)


def _row_of(text: str, title: str, key: str) -> int | None:
    """The line of a key (or of a table of that name), counted from 1; each is looked at once."""
    here = ""
    for row, line in enumerate(text.split("\n"), start=1):
        inner, closed, _ = line.strip().lstrip("[").partition("]")
        if closed and line.lstrip().startswith("["):
            here = inner.strip()
            if here in (key, f"{title}.{key}") and not (title and here == key):
                return row
        elif here == title and _has_key(line, key):
            return row
    return None


def _has_key(line: str, key: str) -> bool:
    """Whether a line begins with a key, plain or quoted."""
    begun = line.strip()
    for named in (key, f'"{key}"', f"'{key}'"):
        if begun.startswith(named) and begun[len(named) :].lstrip()[:1] in ("=", "."):
            return True
    return False


def torque_constants(settings: Section, joints: int) -> Array:
    """What makes newton metres of the recorded efforts, joint by joint (n,); refused if unknown."""
    motion = settings.section("motion")
    unit = motion.word("effort_unit") or UNITS[0]
    if unit not in UNITS:
        raise motion.fault("effort_unit", '"N m" or "A"', "convert the efforts, or name their unit")
    given = "torque_constant" in motion.values
    if unit == "A" and not given:
        mend = "write torque_constant = [...] in N m/A at the joint, one number a joint"
        raise fault(motion.where("effort_unit"), '"A" without torque_constant', "both", mend)
    if not given:
        return np.ones(joints)
    return by_joint(motion, "torque_constant", joints)


def by_joint(section: Section, key: str, joints: int) -> Array:
    """A number for all joints, or one for each (n,), refused if not all are above zero."""
    value = section.values.get(key)
    given = value if isinstance(value, list) else [value]
    numbers = [v for v in given if isinstance(v, int | float) and not isinstance(v, bool)]
    listed = [float(v) for v in numbers if 0.0 < v < constants.LARGEST]
    good = len(listed) == len(given)
    if not good or len(listed) not in (1, joints):
        expected = f"a number above zero, or {joints} of them"
        raise section.fault(key, expected, "give one for all joints, or one a joint")
    return np.broadcast_to(np.array(listed), (joints,)).copy()

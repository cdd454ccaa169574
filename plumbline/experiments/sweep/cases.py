r"""Cases kept as they are done: one line of JSON each, so that a sweep that was ended goes on.

The first line says what the cases are of, the hash of the recording and of the code that diagnosed
them; each further line is one case's options and outcome. A line is there whole or cut short by the
end of the process, and one that was cut short is diagnosed again.
"""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from plumbline.errors import PlumblineError, fault
from plumbline.kinematics.files import read_file, reason

SUFFIX = ".part"
LARGEST = 100_000_000  # [byte]: 10,000 cases of 1 kB, ten times


@dataclass(frozen=True)
class Kept:
    """A file of finished cases, held by this process alone."""

    path: Path  # where it lies
    file: IO[bytes]  # it, open at its end
    lines: tuple[dict[str, Any], ...]  # the cases that were in it

    def add(self, line: dict[str, Any]) -> None:
        """Keep one more case.

        Raises:
            PlumblineError: It cannot be written.
        """
        try:
            self.file.write(json.dumps(line, allow_nan=False).encode() + b"\n")
            self.file.flush()
        except OSError as error:
            raise _unusable(self.path, error) from None

    def remove(self) -> None:
        """Take the file away, the outputs being written."""
        self.path.unlink(missing_ok=True)


@contextmanager
def keeping(path: Path, of: dict[str, str]) -> Iterator[Kept]:
    """The file of finished cases, new or as an earlier sweep left it.

    Raises:
        PlumblineError: It is of something else, cannot be used, or another process holds it.
    """
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NONBLOCK, 0o666)
    except OSError as error:
        raise _unusable(path, error) from None
    with open(number, "r+b", buffering=0) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            whole = read_file(path, LARGEST).rpartition(b"\n")
        except BlockingIOError:
            found, mend = "a sweep at work", "wait for it, or name another output"
            raise fault(str(path), found, "this one alone", mend) from None
        except OSError as error:
            raise _unusable(path, error) from None
        file.truncate(len(whole[0]) + len(whole[1]))  # without a line that was cut short
        lines = _understood(path, whole[0])
        if lines and lines[0] != of:
            odd = next((key for key in of if lines[0].get(key) != of[key]), "kind")
            mend = "delete it, or name another output"
            raise fault(str(path), f"cases of another {odd}", "this one's", mend)
        kept = Kept(path, file, tuple(lines[1:]))
        if not lines:
            kept.add(of)
        yield kept


def _understood(path: Path, whole: bytes) -> list[dict[str, Any]]:
    try:
        lines = [json.loads(line) for line in whole.split(b"\n") if line]
    except (ValueError, RecursionError):
        lines = [None]
    if not all(isinstance(line, dict) for line in lines):
        mend = "delete it, or name another output"
        raise fault(str(path), "no cases of a sweep", "one line of JSON each", mend)
    return lines


def _unusable(path: Path, error: OSError) -> PlumblineError:
    found = f"a file that cannot be used ({reason(error)})"
    return fault(str(path), found, "a place to keep cases", "name another output")

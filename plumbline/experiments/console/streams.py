"""Standard output that takes every character, and whose failure never stops a command.

An encoding that lacks a character gets ``?``. Where nobody reads any more, or a disk is full, the
command goes on, since files may have been asked for too; that its words were lost is said last.
"""

import io
import os
import sys


class Output(io.TextIOWrapper):
    """Standard output that remembers its first failure and takes the rest to nowhere."""

    failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write text; after a failure, it goes nowhere."""
        try:
            return super().write(text)
        except OSError as error:
            self._fail(error)
            return len(text)

    def flush(self) -> None:
        """Hand over what was written."""
        try:
            super().flush()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.failure = self.failure or error
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)


def guard() -> Output | None:
    """Make this process's streams fit for any outcome; its standard output, None if closed."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # closed: a file opened later would take its number, and its words
            os.open(os.devnull, os.O_RDWR)
    if sys.stdout is None:
        return None
    given = sys.stdout
    sys.stdout = found = Output(
        given.buffer, given.encoding, errors="replace", line_buffering=given.isatty()
    )
    return found
